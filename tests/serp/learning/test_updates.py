"""Outputs, losses and steps are those of their definitions, by torch's modules and autograd."""

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from serp import _core
from serp.learning.gradient_updates import draw
from tests.serp.learning.learners import learner, set_q

POLYAK = 0.1


def learning_of(sizes, layer_norm, members, batch, rng, norm=np.inf, polyak=POLYAK):
    """Return networks whose parameters all matter, the target's others than the online one's."""
    made = _core.QLearning(sizes, layer_norm, members, batch, 0.01, norm, polyak)
    for network in (made.online, made.target):
        if network is not None:
            draw(network, rng)
            noise = rng.standard_normal(network.parameters.shape, np.float32)
            network.parameters[...] += noise * np.float32(0.3)
    return made


def samples_of(count, inputs, actions, rng, scale=1.0):
    """Return random samples; every third one imitates nothing."""
    return {
        "observation": rng.standard_normal((count, inputs)).astype(np.float32),
        "action": rng.integers(0, actions, count),
        "reward": (scale * rng.standard_normal(count)).astype(np.float32),
        "next_observation": rng.standard_normal((count, inputs)).astype(np.float32),
        "discount": rng.choice(np.array([0.0, 0.5, 0.9], np.float32), count),
        "imitated": np.where(np.arange(count) % 3, rng.integers(0, actions, count), -1),
        "allowed": np.packbits(rng.random((count, actions)) < 0.6, 1, bitorder="little"),
    }


def module_of(network, member):
    """An independent copy of a member, ``[batch, F]`` → ``[batch, A]``, in double precision."""
    flat = torch.from_numpy(network.parameters[member].copy())
    stack = []
    for k, layer in enumerate(network.layers):
        weight = flat[layer.start : layer.bias].reshape(layer.inputs, layer.outputs)
        vectors = flat[layer.bias : layer.end].reshape(-1, layer.outputs)
        linear = torch.nn.Linear(layer.inputs, layer.outputs)
        linear.load_state_dict({"weight": weight.T, "bias": vectors[0]})
        stack.append(linear)
        if layer.normalized:
            norm = torch.nn.LayerNorm(layer.outputs, eps=_core.NORM_EPSILON)
            norm.load_state_dict({"weight": vectors[1], "bias": vectors[2]})
            stack.append(norm)
        if k + 1 < len(network.layers):
            stack.append(torch.nn.ReLU())
    return torch.nn.Sequential(*stack).double()


def flat(module, of=lambda parameter: parameter.grad):
    """Return the gradients of a module, or else of its parameters, in our order."""
    parts = []
    for layer in module:
        if isinstance(layer, torch.nn.Linear):
            parts += [of(layer.weight).T, of(layer.bias)]
        elif isinstance(layer, torch.nn.LayerNorm):
            parts += [of(layer.weight), of(layer.bias)]
    return torch.cat([part.reshape(-1) for part in parts]).detach().numpy()


@torch.no_grad()
def well_conditioned(module, x):
    """Whether no ReLU is at its corner and no LayerNorm magnifies the last bits of its inputs."""
    for layer in module:
        if isinstance(layer, torch.nn.ReLU) and float(x.abs().min()) <= 1e-5:
            return False
        if isinstance(layer, torch.nn.LayerNorm):
            spread = x.std(-1, correction=0)
            if bool(((spread > 0) & (spread <= 0.1)).any()):
                return False
        x = layer(x)
    return True


def losses(online, target, samples, drawn, weight):
    """Return each member's mean loss, by its definition: one sample at a time."""
    rows = drawn.reshape(len(online), -1)
    x, after = (
        torch.from_numpy(samples[name]).double() for name in ("observation", "next_observation")
    )
    values = [module(x[own]) for module, own in zip(online, rows, strict=True)]
    unit = float(torch.stack(values).detach().std(correction=0))
    found = []
    for member, (q, own) in enumerate(zip(values, rows, strict=True)):
        with torch.no_grad():
            choice, following = online[member](after), target[member](after)
            bits = np.unpackbits(samples["allowed"], 1, choice.shape[1], "little")
            allowed = torch.from_numpy(bits).bool()
            allowed |= ~allowed.any(1, keepdim=True)  # where all are refused, all count
            best = choice.masked_fill(~allowed, -torch.inf).argmax(-1)
        total = torch.zeros((), dtype=torch.float64)
        for i, row in enumerate(own):
            value = samples["discount"][row] * following[row, best[row]]
            total = total + (q[i, samples["action"][row]] - samples["reward"][row] - value) ** 2
            wanted = int(samples["imitated"][row])
            if wanted >= 0:
                margins = torch.full_like(q[i], unit)
                margins[wanted] = 0.0
                total = total + weight * unit * ((q[i] + margins).max() - q[i, wanted])
        found.append(total / len(own))
    return found


@settings(deadline=None, max_examples=80)
@given(
    sizes=st.tuples(st.integers(1, 7), st.integers(1, 5)),
    hidden=st.lists(st.integers(1, 24), max_size=3),
    layer_norm=st.booleans(),
    members=st.integers(1, 3),
    batch=st.integers(1, 17),
    polyak=st.sampled_from([None, POLYAK]),
    weight=st.sampled_from([0.0, 0.5, 2.0]),
    seed=st.integers(0, 2**32),
)
def test_outputs_loss_and_gradient_are_those_of_their_definitions(
    sizes, hidden, layer_norm, members, batch, polyak, weight, seed
):
    (inputs, actions), rng = sizes, np.random.default_rng(seed)
    of = (inputs, *hidden, actions)
    ours = learning_of(of, layer_norm, members, batch, rng, polyak=polyak)
    samples = samples_of(20, inputs, actions, rng)
    drawn = rng.integers(0, 20, members * batch)
    online = [module_of(ours.online, m) for m in range(members)]
    target = online if polyak is None else [module_of(ours.target, m) for m in range(members)]
    x = torch.from_numpy(samples["observation"]).double()
    assume(all(well_conditioned(module, x) for module in online))
    mean = torch.stack([module(x) for module in online]).mean(0).detach().numpy()
    np.testing.assert_allclose(ours.online.q(samples["observation"]), mean, rtol=1e-4, atol=1e-4)

    expected = losses(online, target, samples, drawn, weight)
    sum(expected).backward()
    loss = ours.update(_core.ReplaySamples(**samples), drawn, weight)
    assert loss == pytest.approx(float(sum(expected).detach()) / members, rel=1e-4, abs=1e-5)
    for module, gradient in zip(online, ours.first, strict=True):  # the first step: from 0
        error = np.abs(gradient - flat(module)).max()
        assert error <= 5e-5 * (1 + np.abs(flat(module)).max())


@pytest.mark.parametrize("largest_norm", [None, 0.5])
@pytest.mark.parametrize("members", [1, 3])
def test_steps_are_those_of_torchs_adam(members, largest_norm):
    """Of all sizes of gradients, also where they are too small to count or not there."""
    rng = np.random.default_rng(0)
    norm = np.inf if largest_norm is None else largest_norm
    ours = learning_of((24, 8), False, members, 1, rng, norm)
    theirs = [module_of(ours.online, m) for m in range(members)]
    slow = ours.target.parameters.astype(np.float64)
    optimizer = torch.optim.Adam([p for module in theirs for p in module.parameters()], lr=0.01)
    for step in range(100):
        samples = samples_of(members, 24, 8, rng, 10.0 ** rng.uniform(-4, 3))
        samples["observation"][:, :3] = 0.0 if step % 7 else 1e-20
        samples["discount"][:] = 0.0
        drawn = np.arange(members)
        optimizer.zero_grad()
        sum(losses(theirs, theirs, samples, drawn, 0.0)).backward()
        for module in theirs:
            if largest_norm is not None:
                torch.nn.utils.clip_grad_norm_(module.parameters(), largest_norm)
        optimizer.step()
        ours.update(_core.ReplaySamples(**samples), drawn, 0.0)
        for ours_own, module in zip(ours.online.parameters, theirs, strict=True):
            expected = flat(module, lambda parameter: parameter)
            np.testing.assert_allclose(ours_own, expected, rtol=1e-4, atol=1e-4)
        slow += POLYAK * (ours.online.parameters - slow)
        np.testing.assert_allclose(ours.target.parameters, slow, rtol=1e-5, atol=1e-5)


# Which network says what: Q is the same in every state, online [0, 2, 8], target [0, 4, 1].
ONLINE, TARGET = [0.0, 2.0, 8.0], [0.0, 4.0, 1.0]
SPREAD = float(np.std(ONLINE))


@pytest.mark.parametrize(
    ("changes", "imitated", "ended", "expected"),
    [
        ({"target_polyak": None}, -1, "", (1 + 0.5 * 8) ** 2),
        ({}, -1, "", (1 + 0.5 * 1) ** 2),
        # An end has no value, a time limit does.
        ({"n_step": 3}, -1, "terminated", 1.0),
        ({"n_step": 3}, -1, "truncated", (1 + 0.5 * 1) ** 2),
        # Margin and weight in units of the standard deviation of Q.
        ({}, 1, "terminated", 1 + 0.5 * SPREAD * (8 + SPREAD - 2)),
        ({}, 2, "terminated", 1.0),
    ],
)
def test_each_value_is_asked_of_the_right_network(changes, imitated, ended, expected):
    agent = learner(**{"n_step": 1, "discount": 0.5, **changes})
    agent.imitation_weight = 0.5
    set_q(agent, ONLINE, TARGET)
    x = np.zeros(4, np.float32)
    agent.remember(x, 0, 1.0, x, ended == "terminated", ended == "truncated", imitated)
    assert agent.pretrain(1) == pytest.approx(expected, rel=1e-5)


def test_of_equal_values_the_first_is_the_next_action_and_the_imitated_one_has_no_loss():
    agent = learner(n_step=1, discount=0.5)
    agent.imitation_weight = 0.5
    set_q(agent, [2.0, 2.0, 2.0], [4.0, 1.0, 1.0])
    x = np.zeros(4, np.float32)
    agent.remember(x, 0, 1.0, x, False, False, 1)
    assert agent.pretrain(1) == pytest.approx((1 + 0.5 * 4 - 2) ** 2, rel=1e-5)
