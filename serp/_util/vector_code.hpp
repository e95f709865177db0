// Functions whose loops are worth wider vector registers than every processor has.
#pragma once

#include <cstdlib>  // defines __GLIBC__

#if defined(__x86_64__) && defined(__GLIBC__)
/// Compiles a function three times; the loader takes the version that the processor can run. All give the
/// same bits, because nothing is reordered or contracted.
#define SERP_VECTOR_CODE __attribute__((target_clones("avx512f", "avx2", "default")))
/// Likewise for sums of products in float32, in files compiled with contraction: each version gives bits
/// of its own.
#define SERP_VECTOR_PRODUCTS __attribute__((target_clones("avx512f", "fma", "default")))
#else
#define SERP_VECTOR_CODE
#define SERP_VECTOR_PRODUCTS
#endif

/// A function that becomes part of the functions above that call it.
#if defined(__GNUC__)
#define SERP_INLINE inline __attribute__((always_inline))
#else
#define SERP_INLINE inline
#endif

/// Before a loop whose rounds do not depend on each other.
#if defined(__clang__)
#define SERP_INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#elif defined(__GNUC__)
#define SERP_INDEPENDENT _Pragma("GCC ivdep")
#else
#define SERP_INDEPENDENT
#endif
