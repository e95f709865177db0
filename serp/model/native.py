"""Running a generated transition function as machine code, by numba.

The generated function is compiled separately, to a C callback. Loops over states (the lookahead,
batches) are compiled once for all domains and call it through its address. After an edit of a
domain file only one small function is compiled, or none where only numbers changed. Both are
cached on disk, see `serp._util.compilation`.
"""

from __future__ import annotations

import hashlib
from typing import Any, Final

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from serp._util.compilation import cached_cfunc, cached_njit
from serp.model.codegen import Generated, load_function

_POINTER = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
STEP_SIGNATURE = types.int64(_POINTER, types.int64, _POINTER, types.float64, _POINTER)
"""The signature of every compiled transition function: state, action, data, Δt, out → flags."""

_intrinsic: Any = intrinsic
OUTCOMES: Final = 16
"""Most outcomes of one step, see `TransitionModel.native_outcomes`; callers make room for them."""

STACK: Final = 256
"""Most numbers that loops over fluents keep on the stack, see `stack_room`: 2 KB."""


def compile_native(generated: Generated) -> Any:
    """Compile a generated `step` to a C callback; keep it alive while its address is in use."""
    # The file does not exist; its name is the key of the cached code.
    digest = hashlib.sha256(generated.text.encode()).hexdigest()[:24]
    function = load_function(generated, f"<model {digest}>")
    # `error_model`: divisions are guarded in the generated code, so no check is compiled in.
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(function)


def address_of(callback: Any) -> np.intp:
    """Return the address of a compiled callback in the type that `call_step` expects."""
    return np.intp(callback.address)


# For compiled code. Loops over rows use pointers: unlike slices and array arguments they cost
# neither reference counts nor checks for negative positions.


@_intrinsic
def pointer_to(typing_context, array, position):  # type: ignore[no-untyped-def]
    """Return a pointer to one entry of a flat float64 array.

    The array must be an argument of the calling function, so that it is kept alive.
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        made = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.gep(made.data, [arguments[1]])

    return _POINTER(array, position), generate


@_intrinsic
def call_step(typing_context, address, state, action, theta, dt, out):  # type: ignore[no-untyped-def]
    """Call a compiled `step`; return its flags (int64).

    It takes the address of the callback (intp), pointers to the state, θ and the copy of the state
    to change, the position of the action, and Δt.
    """

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        real, integer = ir.DoubleType(), ir.IntType(64)
        pointer = real.as_pointer()
        kind = ir.FunctionType(integer, [pointer, integer, pointer, real, pointer])
        callee = builder.inttoptr(arguments[0], kind.as_pointer())
        return builder.call(callee, arguments[1:])

    return types.int64(address, state, action, theta, dt, out), generate


@_intrinsic
def advanced(typing_context, pointer, count):  # type: ignore[no-untyped-def]
    """Return a pointer advanced by a number of entries."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.gep(arguments[0], [arguments[1]])

    return _POINTER(pointer, count), generate


@_intrinsic(prefer_literal=True)
def stack_room(typing_context, size):  # type: ignore[no-untyped-def]
    """Return a pointer to `size` (a constant) numbers, valid until the function returns."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        with builder.goto_entry_block():
            return builder.alloca(ir.DoubleType(), size=size.literal_value)

    return _POINTER(size), generate


@cached_njit(nogil=True)
def step_batch(model, states, actions, out, flags):  # type: ignore[no-untyped-def]
    """Step a batch of a model, see `TransitionModel.machine_code`.

    States are flat `[B * F]`, actions `[B]`. `out`, flat `[B * (F + 1)]`, receives the next states,
    each followed by its reward; `flags`, `[B]`, the flags.
    """
    batch = actions.shape[0]
    width = states.shape[0] // max(batch, 1)
    address, data, dt = model
    parameters = pointer_to(data, 0)
    for row in range(batch):
        state, target = pointer_to(states, row * width), pointer_to(out, row * (width + 1))
        for column in range(width):
            target[column] = state[column]
        flags[row] = call_step(address, state, actions[row], parameters, dt, target)
