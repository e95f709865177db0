"""How far an input is from the data: its leverage in the regression.

A planner knows what it knows (KWIK: Li, Littman & Walsh, ICML 2008).
"""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.adaptation.residual import parameters as r
from serp.adaptation.residual.features import features_of
from serp.model.native import advanced

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True, forceinline=True)
def columns_in_use(known, columns, most):
    """Return how many columns of the regression tell what is known.

    Where no target is predicted from features (`most` is the largest of the kinds in use), what the
    linear model knows is known.
    """
    return min(known, columns) if most <= r.LINEAR else known


@cached_njit(nogil=True, forceinline=True)
def leverage(inverse, stride, known, columns, heads, row, head, u, depth, z):
    """Return the leverage of an input: 0 where much is known, 1 where nothing is.

    It is q / (1 + q), where q is the posterior variance of the smooth model in units of that of an
    observation. `inverse` is that of the Cholesky factor, of `known` columns; `z` are the features.
    """
    if known == 0:
        return 1.0
    q = 0.0
    block = 1 + depth
    for i in range(known):
        total, at = 0.0, i * stride
        for place in range(3):
            start = 0
            if place == 1:
                start = (1 + head) * block
            elif place == 2:
                if row < heads:
                    break
                start = (1 + row) * block
            if start > i:
                break
            total += inverse[at + start]
            for k in range(min(depth, i - start)):
                total += inverse[at + start + 1 + k] * u[k]
        for k in range(i + 1 - columns):
            total += inverse[at + columns + k] * z[k]
        q += total * total
    return q / (1.0 + q)


@cached_njit(nogil=True, forceinline=True)
def leverage_at(buffer, part, row, head, most, u, depth, z):
    """Return the leverage of normalised inputs where `most` is the largest kind in use.

    `z` receives the features.
    """
    columns = (1 + int(buffer[part + r.R_ROWS])) * (1 + depth)
    known = columns_in_use(int(buffer[part + r.R_KNOWN]), columns, most)
    if known > columns:
        features_of(
            advanced(buffer, int(buffer[part + r.R_FREQUENCY])),
            advanced(buffer, int(buffer[part + r.R_PHASE])), u, depth, 0, z,
        )  # fmt: skip
    return leverage(
        advanced(buffer, int(buffer[part + r.R_INVERSE])), columns + r.SMOOTH, known, columns,
        int(buffer[part + r.R_HEADS]), row, head, u, depth, z,
    )  # fmt: skip
