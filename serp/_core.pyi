"""
The compiled part of serp: steps of a model, planning on it, and learning.
"""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy
import numpy.typing
from numpy.typing import NDArray


class Program:
    """The instruction table of a ground model."""

    def __init__(self, code: Annotated[NDArray[numpy.uint32], dict(shape=(None, 4), order='C', device='cpu', writable=False)], entries: Annotated[NDArray[numpy.uint32], dict(shape=(None,), order='C', device='cpu', writable=False)], fluents: int, parameters: int, intermediate: int) -> None:
        """
        Check a table: instructions [n, 4], and where the parts begin [4 + 2A]: drift, settle, aftermath, goal, the actions, the judged actions.
        """

    @property
    def fluents(self) -> int: ...

    @property
    def actions(self) -> int: ...

    @property
    def parameters(self) -> int: ...

    @property
    def intermediate(self) -> int:
        """The number of intermediate results."""

    @property
    def code(self) -> NDArray[numpy.uint32]:
        """A copy of the instructions [n, 4]."""

    @property
    def entries(self) -> NDArray[numpy.uint32]:
        """A copy of the positions of the parts [4 + 2A]."""

class Model:
    """A transition model as planners take it."""

    @property
    def fluents(self) -> int: ...

    @property
    def actions(self) -> int: ...

    @property
    def branches(self) -> bool:
        """Whether a step may have several outcomes."""

    @property
    def doubts(self) -> bool:
        """Whether a step may be uncertain."""

    def step(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], action: int) -> tuple[NDArray[numpy.float64], int]:
        """Return next state and reward [F + 1], and the flags."""

    def step_batch(self, states: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], actions: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple[NDArray[numpy.float64], NDArray[numpy.int64]]:
        """Return next states and rewards [B, F + 1], and the flags [B]."""

    def outcomes(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], action: int) -> NDArray[numpy.float64]:
        """
        Return the outcomes of a step: next state, reward, flags and probability [n, F + 3].
        """

    def uncertainty(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> NDArray[numpy.float64]:
        """Return how far each action is from the data [A]."""

class WrittenModel(Model):
    """The model as the file has it."""

    def __init__(self, program: Program, theta: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], dt: float) -> None: ...

    def step(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], action: int) -> tuple[NDArray[numpy.float64], int]:
        """
        Return next state and reward [F + 1], and the flags; action -1 is none.
        """

    def judge(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], action: int, next_state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple[NDArray[numpy.float64], int]:
        """
        Return the observed next state after events, then its reward [F + 1], and the flags.
        """

    def at_goal(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> bool:
        """Return whether the goal holds in a state."""

class GroupParameters:
    """What is learned of the feature groups of one key."""

    def __init__(self, regression: Regression | None, head: int) -> None: ...

    @property
    def regression(self) -> Regression | None:
        """
        The regression of the residual; None where there are too many inputs to learn.
        """

    @property
    def head(self) -> int:
        """The head of the action schema in the regression."""

    @property
    def outcomes(self) -> OutcomeTable | None:
        """The counts in use, or None. A ValueError says that they do not fit."""

    @outcomes.setter
    def outcomes(self, table: OutcomeTable | None) -> None: ...

class ObservedStep:
    """An observed transition, beside what the file says of it."""

    @property
    def over(self) -> bool:
        """Whether it ended the episode."""

    @property
    def usable(self) -> bool:
        """Whether its numbers are small enough to learn from."""

    def count_whole(self, whole: Annotated[NDArray[numpy.bool_], dict(shape=(None,), order='C', device='cpu')], numeric: Annotated[NDArray[numpy.bool_], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> int:
        """
        Note in `whole` `[F]` which numbers are not whole; return how many fluents are.
        """

    def predicted(self, columns: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> bool:
        """Return whether the file predicted these fluents of the next state."""

class AdaptedModel(Model):
    """A model that is adapted to observed transitions."""

    def __init__(self, written: WrittenModel, others: Annotated[NDArray[numpy.int64], dict(shape=(None, None), order='C', device='cpu', writable=False)], flagging: bool, groups: Sequence[Sequence[tuple[Sequence[int], Sequence[int], GroupParameters]]]) -> None:
        """
        `others` `[A, S]` are the ground actions of each schema with the same arguments, -1 for none. `flagging` says whether events can make `unsafe` true. `groups` are inputs, targets and parameters of the feature groups of every ground action.
        """

    @property
    def active(self) -> bool:
        """Whether anything adapted is in use."""

    @property
    def revised(self) -> bool:
        """Whether parameters in use differ from those written."""

    @property
    def parameters(self) -> NDArray[numpy.float64]:
        """A copy of the parameters in use `[P]`."""

    def adopt(self, parameters: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """Use parameters `[P]` from now on."""

    def observe(self, state: numpy.typing.NDArray[numpy.float64], action: int, next_state: numpy.typing.NDArray[numpy.float64], over: bool) -> ObservedStep | None:
        """
        Return an observed transition to learn from; None if the action is not applicable by the file. `over` says whether it ended the episode.
        """

    def branches_of(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], action: int) -> NDArray[numpy.float64]:
        """
        Return all outcomes before events: state, reward, 0 and probability `[n, F + 3]`.
        """

class Regression:
    """
    A regression of the one-step error of the file: H heads (action schemas), d inputs, T targets, D columns of the linear part.
    """

    def __init__(self, heads: int, depth: int, count: int) -> None: ...

    @property
    def heads(self) -> int: ...

    @property
    def depth(self) -> int: ...

    @property
    def count(self) -> int: ...

    @property
    def columns(self) -> int: ...

    @property
    def features(self) -> int:
        """Number of random features in use: 0 or FEATURES."""

    @features.setter
    def features(self, arg: int, /) -> None: ...

    @property
    def known(self) -> int:
        """Rows of the inverse in use; 0 before the first solution."""

    @known.setter
    def known(self, arg: int, /) -> None: ...

    @property
    def kinds(self) -> NDArray[numpy.int64]:
        """The predictor in use of each target `[T]`, a copy; set all at once."""

    @kinds.setter
    def kinds(self, arg: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], /) -> None: ...

    def clear(self) -> None:
        """Set all weights to 0: the file predicts alone."""

    def design_matrix(self, x: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], heads: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], weight: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> NDArray[numpy.float64]:
        """
        Return rows of the design matrix `[n, D + features]` of inputs `[n, d]` and their heads `[n]`, each times its weight `[n]`.
        """

    SMOOTH: int = 64

    FEATURES: int = 256

    RANGE: float = 1.3

    @property
    def linear(self) -> NDArray[numpy.float64]:
        """
        `[H, 3, T, 1 + d]` weights of a constant and the normalised inputs, by predictor.
        """

    @property
    def amplitude(self) -> NDArray[numpy.float64]:
        """`[2, T, FEATURES]` weights of the random features, by predictor."""

    @property
    def centre(self) -> NDArray[numpy.float64]:
        """`[d]`; normalised inputs are (x - centre) * shrink."""

    @property
    def shrink(self) -> NDArray[numpy.float64]:
        """`[d]`."""

    @property
    def frequency(self) -> NDArray[numpy.float64]:
        """`[d, FEATURES]`."""

    @property
    def phase(self) -> NDArray[numpy.float64]:
        """`[FEATURES]`."""

    @property
    def inverse(self) -> NDArray[numpy.float64]:
        """
        `[D + SMOOTH, same]` transposed inverse of the Cholesky factor of the smooth model.
        """

    @property
    def typical(self) -> NDArray[numpy.float64]:
        """`[H, T]` typical error of the predictor in use."""

    @property
    def scale(self) -> NDArray[numpy.float64]:
        """
        `[4, T]` typical error where nothing is known, typical change, and two sums that the first is computed from.
        """

class Samples:
    """
    The newest samples of a regression, the ranges of their inputs, and the errors of all predictors, each before the sample was learned from.
    """

    def __init__(self, regression: Regression) -> None: ...

    def clear(self) -> None:
        """Forget everything."""

    def clear_errors(self) -> None:
        """Forget the errors of the predictors."""

    def learn(self, head: int, step: ObservedStep, inputs: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], targets: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], whole: Annotated[NDArray[numpy.bool_], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> int:
        """
        Learn from a step: columns of inputs `[d]` and targets `[T]` in its states, and which fluents `[F]` have always been whole numbers, which a residual does not predict.

        Returns NOTHING; FIT where sums or weights are due for an update, or FORGET: the same after a lasting change of the world. After an update, `choose` must be called.
        """

    def choose(self, targets: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], whole: Annotated[NDArray[numpy.bool_], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """
        Choose the predictor of each target; the arguments are those of `learn`.

        Of the file and the residuals, it is the simplest one that no other beats clearly: by 5 %, and features by a hundredth of the change too. One that is in use is kept until it is beaten at all.
        """

    def solution_due(self) -> bool:
        """Return whether weights are to be solved."""

    def centre_and_half(self) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]:
        """
        Return the centres of the ranges `[d]` and half their widths `[d]`, 1 for what never changed.
        """

    def rows(self, first: int, last: int) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.uint8], NDArray[numpy.int64], NDArray[numpy.float64]]:
        """
        Return samples by their number: inputs `[n, d]`, errors `[n, T]`, whether these are observed (0 or 1), heads `[n]` and weights `[n]`.
        """

    def restore(self, number: int, x: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], y: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], valid: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu', writable=False)], heads: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], weight: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """
        Forget everything, and keep the newest samples of `number`, in order of time; a ValueError says what does not fit.
        """

    @property
    def kept(self) -> int:
        """Number of samples that are kept."""

    @property
    def number(self) -> int:
        """Number of samples ever kept."""

    @property
    def start(self) -> int:
        """Number of samples before the present world."""

    @start.setter
    def start(self, arg: int, /) -> None: ...

    @property
    def pending(self) -> int:
        """Number of the newest samples not in the sums."""

    @pending.setter
    def pending(self, arg: int, /) -> None: ...

    @property
    def since_solved(self) -> int:
        """Samples since weights were solved."""

    @since_solved.setter
    def since_solved(self, arg: int, /) -> None: ...

    @property
    def outliers(self) -> int:
        """Successive outliers."""

    @outliers.setter
    def outliers(self, arg: int, /) -> None: ...

    @property
    def alarms(self) -> int:
        """Successive samples by which the world may have changed."""

    @alarms.setter
    def alarms(self, arg: int, /) -> None: ...

    @property
    def of_episode(self) -> int:
        """Samples since the episode began."""

    @of_episode.setter
    def of_episode(self, arg: int, /) -> None: ...

    NOTHING: int = 0

    FIT: int = 1

    FORGET: int = 2

    KEPT: int = 4096

    PENDING: int = 32

    REMEMBERED: int = 8

    @property
    def loss(self) -> NDArray[numpy.float64]:
        """`[4, T]` moving averages of errors by predictor."""

    @property
    def seen(self) -> NDArray[numpy.float64]:
        """`[T]` samples in them."""

    @property
    def spread(self) -> NDArray[numpy.float64]:
        """`[T]` mean change."""

    @property
    def samples(self) -> NDArray[numpy.float64]:
        """`[H, T]` samples of each head."""

    @property
    def surprises(self) -> NDArray[numpy.float64]:
        """`[1]` fraction of surprises."""

    @property
    def low(self) -> NDArray[numpy.float64]:
        """`[d]` lower ends of the ranges of inputs."""

    @property
    def high(self) -> NDArray[numpy.float64]:
        """`[d]` upper ends of them."""

    @property
    def block_of(self) -> NDArray[numpy.int64]:
        """`[T]` which matrix of sums each target is in: 0 or 1."""

class OutcomeTable:
    """
    Counts of the outcomes of the ground actions that share the key of a feature group.
    """

    def __init__(self, places: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], context: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """Counted fluents, and those of a context: positions within the inputs."""

    def count(self, step: ObservedStep, inputs: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], losses: Annotated[NDArray[numpy.float64], dict(shape=(2), order='C', device='cpu')], rate: float) -> bool:
        """
        Update the losses `[2]` of the file and of the counts, and then count a sample.

        Returns False where the sample is no outcome, and there is no room for another.
        """

    def start(self, samples: float) -> None:
        """Count samples that were as in the file, before all others."""

    def emptied(self) -> OutcomeTable:
        """
        Return a table with the same outcomes, 'nothing changes' among them, and no counts.
        """

    def contents(self) -> dict[str, numpy.typing.NDArray[numpy.float64]]:
        """
        Return the arrays that `restore` takes: K outcomes, R rows of counts (the first over all contexts).
        """

    def restore(self, schemas: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], changes: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], trust: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], sets: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], codes: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], counts: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], totals: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], evidence: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)]) -> None:
        """Replace the contents; a ValueError says what does not fit."""

class LeafValues:
    """Values of the states where a lookahead ends."""

class Lookahead:
    """The planning graph of one state with a depth."""

    def __init__(self, model: Model, depth: int, discount: float, accepted_risk: float, max_nodes: int, max_edges: int) -> None: ...

    def forecast(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], leaves: LeafValues | None) -> tuple[tuple[int, NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.int64], NDArray[numpy.float64], NDArray[numpy.int64], int, int], int]:
        """
        Return the fields of a `Forecast` for a state [F], and the edges followed for it.
        """

    def forecast_batch(self, states: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], leaves: LeafValues | None, threads: int) -> list[tuple[tuple[int, NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.int64], NDArray[numpy.float64], NDArray[numpy.int64], int, int], int]]:
        """Return what `forecast` returns for states [B, F]."""

    def paths(self) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.int64]]:
        """
        Return value, risk and safe steps [n] of the best path from each expanded state of the newest forecast, in the order in which they were found.
        """

class ClosedGraph:
    """All states that can be reached, and the best action in each."""

    def __init__(self, model: Model, discount: float, accepted_risk: float, max_edges: int) -> None: ...

    def clear(self, inert: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """Forget all nodes; `inert` are fluents that make no difference."""

    def grow(self, states: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], limit: int) -> None:
        """
        Add states [n, F] and what can be reached from them, and solve the graph.
        """

    def solve(self) -> None:
        """Find the best policy of every node."""

    def forecast(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple[int, NDArray[numpy.float64], NDArray[numpy.float64], NDArray[numpy.int64], NDArray[numpy.float64], NDArray[numpy.int64], int, int] | None:
        """
        Return the fields of a `Forecast` for a state [F]; None where the state is not in the graph, or its best policy leaves the graph.
        """

    def ends(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> bool:
        """
        Return whether the best policy leads from a state [F] to the end of the task.
        """

    @property
    def nodes(self) -> int: ...

    @property
    def expanded(self) -> int: ...

    @property
    def edges(self) -> int: ...

    @property
    def spreads(self) -> bool: ...

    @property
    def largest(self) -> float:
        """Largest magnitude of a number in all states."""

    def columns(self) -> dict[str, numpy.typing.NDArray[Any]]:
        """Return copies of all columns."""

    def restore(self, columns: dict[str, numpy.typing.NDArray[Any]]) -> None:
        """
        Take a graph with these columns, or raise a ValueError where they do not fit together. What follows from the others is not read.
        """

AREAS: float = 8.0

class CellValues(LeafValues):
    """The values of N cells."""

    def __init__(self, low: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], scale: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], area: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], states: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], value: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], area_value: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)] | None = None) -> None:
        """
        Take a division of the state space: low ends, bins per unit of cells and of areas [F]; a state of every cell [N * F]; the values [N + 1] of the cells and of what is not known; those of the areas [A + 1], the least of their cells where they are not given.
        """

    def at(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> float:
        """Return the value of a state [F]."""

    def set(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], value: float) -> None:
        """Set the value of the cell of a state [F], if it is there."""

    @property
    def unknown(self) -> float:
        """The value of what is not known."""

    def columns(self) -> dict[str, NDArray[numpy.float64]]:
        """Return copies of what the values are made from, by name."""

class CellGraph:
    """A planning graph over cells of the state space."""

    def __init__(self, discount: float, accepted_risk: float, max_edges: int) -> None: ...

    @property
    def nodes(self) -> int: ...

    @property
    def edges(self) -> int: ...

    def expand(self, model: Model, low: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], scale: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], area: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], roots: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu', writable=False)], limit: int) -> tuple[int, bool]:
        """
        Expand the graph anew from states [N, F], in a division that `CellValues` describes. Return the steps that were predicted, at most about `limit`, and whether the graph is complete.
        """

    def lasting_rates(self) -> tuple[NDArray[numpy.float64], NDArray[numpy.int32]]:
        """
        Return rewards per control period, and actions, of the edges after which the task goes on.
        """

    def begin(self, former: CellValues | None, otherwise: float) -> None:
        """
        Begin with former values of cells; with `otherwise` where there are none.
        """

    def solve(self, worst: float, beyond: float) -> float:
        """
        Find the values of the cells; return that of the first one. What is unsafe is worth `worst`, what is not known `beyond`.
        """

    def values(self, unknown: float) -> CellValues:
        """Return the values of the cells, and of what is not known."""

class Relaxation:
    """Facts and operators of a relaxed domain."""

    def __init__(self, fluents: int, comparisons: Sequence[tuple[Sequence[tuple[int, float]], float, bool]], operators: Sequence[tuple[Sequence[int], float, Sequence[tuple[int, float]]]], ways: Sequence[Sequence[int]]) -> None:
        """
        Facts 2 i and 2 i + 1 say that fluent i is 0, or is not; the others are comparisons: fluents and factors, constant, and whether the sum has to be positive. An operator has the facts that it needs, a cost, and the facts that it makes true; for each of these what one application adds to the sum of a comparison, 0 where one is enough. A way to the goal is the facts that it needs.
        """

    def estimate(self, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple[float, int]:
        """
        Return how far away the goal is from a state [F]: its additive cost, infinite if it is unreachable, and the least number of facts of a way to it that do not hold.
        """

def find_way(model: Model, relaxation: Relaxation, inert: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], binary: bool, accepted_risk: float, state: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C', device='cpu', writable=False)], limit: int) -> tuple[int, NDArray[numpy.float64] | None]:
    """
    Search for a way from a state [F] to the goal. Return the edges that were followed, about `limit` at most, and the states [N, F] on the way but the last one; None where none was found. Fluents `inert` become 0 in these. `binary` says that all others are 0 or 1.
    """

NORM_EPSILON: float = 9.999999747378752e-06

def add_bias(z: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], parameters: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], at: int, floor: float) -> None:
    """Set z [E, B, H] to max(z + bias, floor)."""

def normalize(z: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], h: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], inverse: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], parameters: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], at: int) -> None:
    """
    Set h [E, B, H] to ReLU(LayerNorm(z + bias)). z becomes the normalised value before gain and shift, inverse [E, B] the reciprocal of each row's standard deviation.
    """

def add_bias_backward(d: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], gradient: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], at: int) -> None:
    """Write the gradient of a bias: the sum of d [E, B, H] over the batch."""

def relu_backward(d: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], h: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], gradient: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], at: int) -> None:
    """
    Turn dloss/dh in d [E, B, H] into dloss/dz; write the gradient of the bias.
    """

def normalize_backward(d: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], h: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], z: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], inverse: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], parameters: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], gradient: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], at: int) -> None:
    """
    Turn dloss/dh in d into dloss/dz; the other arrays are as `normalize` left them. Write the gradients of bias, gain and shift. With x the normalised row and g = d * gain, dz = (g - mean(g) - x * mean(g * x)) / standard deviation (arXiv 1607.06450).
    """

def adam(parameters: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], gradient: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], first: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], second: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], rate: float, epsilon: float, largest_norm: float, average: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], share: float) -> None:
    """
    Do one step of Adam in place; all arrays are [E, P], average may be [E, 0].
    """

def deviation(q: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')]) -> float:
    """Return the standard deviation of q [E, B, A]."""

def td_gradient(q: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], next_q: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], choice_q: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')], action: Annotated[NDArray[numpy.int64], dict(shape=(None, None), order='C', device='cpu', writable=False)], reward: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], discount: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], forbidden: Annotated[NDArray[numpy.bool_], dict(shape=(None, None, None), order='C', device='cpu', writable=False)], lower: float, upper: float, imitated: Annotated[NDArray[numpy.int64], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None, margin: float, weight: float, q_gradient: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')]) -> float:
    """
    Write the gradient of each member's mean loss; return the mean loss over members and batch. The target of a sample is reward + discount * next_q[best], with best the action of largest choice_q among those not forbidden (the lowest index in a tie), and next_q[best] clipped to lower and upper. With an action g to be imitated, weight * (max over a of (q[a] + margin * [a != g]) - q[g]) is added to the loss of the sample. q and the like are [E, B, A].
    """
