// Functions whose loops are worth wider vector registers than every processor has.
#pragma once

#include <cstdlib>  // defines __GLIBC__

#if defined(__x86_64__) && defined(__GLIBC__)
/// Compiles a function three times; the loader takes the version that the processor can run. All give the
/// same bits, because nothing is reordered or contracted.
#define SERP_VECTOR_CODE __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define SERP_VECTOR_CODE
#endif
