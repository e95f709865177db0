// Blocks of numbers as Python sees them.
#pragma once

#include "serp/_util/arrays.hpp"
#include "serp/model/learned/regression.hpp"

namespace serp {

/// Binds a writable view of a block.
template <class Class, class Number>
void bind_view(nb::class_<Class>& bound, const char* name, Block<Number> Class::*block) {
    bound.def_prop_ro(
        name,
        [block](nb::pointer_and_handle<Class> self) {
            Block<Number>& of = self.p->*block;
            return Array<Number>(of.data(), of.shape.size(), of.shape.data(), self.h);
        },
        nb::rv_policy::reference);
}

}  // namespace serp
