"""Random domains, problems and states for tests, and a slow reading of the domain language.

    from tests.generated import PLANNABLE, models_with_states

    @given(models_with_states(PLANNABLE))
    @examples(100)
    def test_something(drawn): generated, states = drawn; generated.model.step(states, 0)

Outside of hypothesis, `generate(Random(seed), rewarding)` and `random_states(...)` do the same.
"""

from tests.generated.models import (
    Generated,
    generate,
    load_texts,
    models_with_states,
    random_states,
)
from tests.generated.profile import examples
from tests.generated.writer import FULL, PLANNABLE, Texts, write_texts

__all__ = [
    "FULL",
    "PLANNABLE",
    "Generated",
    "Texts",
    "examples",
    "generate",
    "load_texts",
    "models_with_states",
    "random_states",
    "write_texts",
]
