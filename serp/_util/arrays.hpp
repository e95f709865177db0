// NumPy arrays at the border between Python and C++.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace serp {

namespace nb = nanobind;

/// A C-contiguous array in memory that the callee only reads. nanobind copies what is not.
template <class T, class... Shape>
using In = nb::ndarray<const T, nb::c_contig, nb::device::cpu, Shape...>;
/// A C-contiguous array that the callee writes to; bind it with `.noconvert()`, or it may be a copy.
template <class T, class... Shape>
using Out = nb::ndarray<T, nb::c_contig, nb::device::cpu, Shape...>;
/// A new NumPy array.
template <class T>
using Array = nb::ndarray<nb::numpy, T>;

/// Returns a NumPy array of a shape that owns the numbers.
template <class T>
Array<T> array_of(std::vector<T>&& numbers, std::initializer_list<size_t> shape) {
    auto* held = new std::vector<T>(std::move(numbers));
    nb::capsule owner(held, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return Array<T>(held->data(), shape, owner);
}

/// Returns a NumPy view of numbers that `owner`, a bound object, keeps alive and never moves.
/// `strides`, if given, are the numbers from one entry to the next along each axis.
template <class T>
Array<T> view_of(T* numbers, std::initializer_list<size_t> shape, nb::handle owner,
                 std::initializer_list<std::int64_t> strides = {}) {
    return Array<T>(numbers, shape, owner, strides);
}

/// Numbers of a fixed shape, row after row; Python sees them as an array that it may write to.
template <class Number>
struct Block : std::vector<Number> {
    /// All numbers are 0.
    template <class... Sizes>
    explicit Block(Sizes... sizes)
        : std::vector<Number>((std::size_t{1} * ... * static_cast<std::size_t>(sizes))),
          shape{static_cast<std::size_t>(sizes)...} {}

    void fill(Number number) { std::fill(this->begin(), this->end(), number); }

    const std::vector<std::size_t> shape;
};

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

/// Returns the numbers of a state [F]; throws std::invalid_argument where it has others than F.
inline const double* state_of(const In<double, nb::ndim<1>>& state, size_t fluents) {
    if (state.size() != fluents)
        throw std::invalid_argument("a state must have " + std::to_string(fluents) + " numbers");
    return state.data();
}

/// Returns a copy of an array as a vector.
template <class T, class... Annotations>
std::vector<T> vector_of(const nb::ndarray<const T, Annotations...>& array) {
    return std::vector<T>(array.data(), array.data() + array.size());
}

}  // namespace serp
