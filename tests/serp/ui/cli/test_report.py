"""`serp report`: the page of a run, as its data and in a browser."""

import base64
import gzip
import json
import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner

from serp.runs.run import Run
from serp.runs.tables import read_metrics
from serp.ui.report.report import write_report
from serp.ui.root import serp
from tests.serp.ui.cli.conftest import QUICK, train
from tests.serp.ui.studio.browser import CHROMIUM, chromium
from tests.worlds import DOMAINS

HOSTILE = "</script><script>document.title = 'taken'</script><img src=x onerror=alert(1)>"
CARTPOLE = DOMAINS / "cartpole.pddl"


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A short run of cart-pole, of a file with a comment that is HTML."""
    folder = tmp_path_factory.mktemp("report")
    text = CARTPOLE.read_text(encoding="utf-8")
    assert "(unsafe)" in text
    file = folder / "cartpole.pddl"
    file.write_text(text.replace("(:predicates", f"; {HOSTILE}\n  (:predicates", 1))
    return train(folder / "run", f"--domain={file}", "--episodes=4", *QUICK)


@pytest.fixture(scope="module")
def page(trained):
    """Its report."""
    done = CliRunner().invoke(serp, ["report", str(trained), "--pictures=60"])
    assert done.exit_code == 0, done.output
    return trained / "report.html"


def data_of(page):
    """The JSON values and the arrays of a page."""
    parts = dict(re.findall(r'<script type="[^"]*" id="(\w+)">(.*?)</script>', page.read_text()))
    meta = json.loads(parts["meta"])
    packed = gzip.decompress(base64.b64decode(parts["arrays"]))
    arrays, at = {}, 0
    for name, kind, count in meta["layout"]:
        arrays[name] = np.frombuffer(packed, np.dtype(kind).newbyteorder("<"), count, at)
        at += arrays[name].nbytes
    assert at == len(packed)
    return meta, arrays


def test_the_page_has_what_was_recorded(trained, page):
    meta, arrays = data_of(page)
    recording = Run(trained).recording()
    columns = recording.columns("state", "action", "value", "flags", "reward")
    count, fluents = columns["state"].shape
    assert meta["steps"] == count
    assert (arrays["executed"] == columns["action"]).all()
    for name, column in (("state", "state"), ("value", "value"), ("reward", "reward")):
        shown = arrays[name].reshape(-1, count).T
        np.testing.assert_allclose(shown, columns[column], rtol=2e-5, atol=1e-30)
    metrics = read_metrics(trained / "metrics.csv")
    assert [each["return"] for each in meta["episodes"]] == pytest.approx(metrics["return"])
    assert (arrays["bits"] & 1).sum() == metrics["vetoes"].sum() > 0
    assert [each["steps"] for each in meta["episodes"]] == metrics["length"].tolist()
    # The causes of the reward of an executed or refused action add up to it, as it was predicted.
    of_step = np.repeat(np.arange(count), np.diff(arrays["causeAt"]))
    rewards = np.array([cause["kind"] == "reward" for cause in meta["causes"]])[arrays["cause"]]
    gained = np.zeros((count, len(meta["actions"])))
    np.add.at(gained, (of_step, arrays["causeAction"]), arrays["amount"] * rewards)
    shown = np.zeros(gained.shape, bool)
    shown[of_step, arrays["causeAction"]] = True
    assert shown[np.arange(count), columns["action"]].all() and not shown.all()
    shown &= columns["flags"] & 1 == 1
    np.testing.assert_allclose(gained[shown], columns["reward"][shown], atol=1e-4)
    # Every picture is a WebP.
    first, second = arrays["pictureAt"][:2]
    assert arrays["pictures"][first:second].tobytes()[8:12] == b"WEBP"
    # Every veto is counted for one thing that it prevented.
    cards = re.findall(r"<li><strong>([\d,]+) ×", page.read_text())
    assert sum(int(count.replace(",", "")) for count in cards) == metrics["vetoes"].sum()
    assert ((arrays["card"] > 0) == (arrays["bits"] & 1 > 0)).all()
    # What the last step of an episode led to is that of no other step.
    last = arrays["last"].reshape(fluents, -1).T
    steps = recording.columns("next_state", "terminated", "truncated")
    ends = steps["terminated"] | steps["truncated"]
    np.testing.assert_allclose(last, steps["next_state"][ends], rtol=2e-5)


def test_an_evaluation_is_drawn_by_its_recorded_seed(run, trained, tmp_path):
    run("evaluate", str(trained), "--policy=planner", "--episodes=1", "--seed=3")
    folder = trained / "evaluations" / "before"
    (trained / "evaluations" / "planner-seed3").rename(folder)
    header = json.loads((folder / "recording.json").read_text())

    def pictures(**changes):
        (folder / "recording.json").write_text(json.dumps({**header, **changes}))
        done = run("report", str(trained), "--evaluation=before", "-o", f"{tmp_path}/x.html",
                   "--pictures=3")  # fmt: skip
        assert done.exit_code == 0
        (episode,) = data_of(tmp_path / "x.html")[0]["episodes"]
        return episode["frames"], episode["note"]

    assert pictures()[0] == 3
    assert "did not reach the recorded state" in pictures(seed=4)[1]
    assert "does not give its seed" in pictures(seed=None)[1]


def test_the_first_page_is_whole_and_further_runs_are_drawn_over_it(run, trained, tmp_path):
    first, other = [], Run(shutil.copytree(trained, tmp_path / "other"))
    target = tmp_path / "page.html"
    write_report(Run(trained), target, evaluation=None, steps=9_999, pictures=0, others=[other],
                 on_first=lambda: first.append(target.read_text()))  # fmt: skip
    assert "This is the first page" in first[0]
    meta, arrays = data_of(target)
    assert "This is the first page" not in target.read_text() and meta["others"] == [
        f"{other.path}"
    ]
    np.testing.assert_allclose(arrays["otherMean0"], arrays["mean"], rtol=1e-5)
    foreign = train(tmp_path / "hill", "--domain=hill", "--episodes=1", *QUICK)
    told = run("report", str(trained), str(foreign), expect=1).stderr
    assert "(hill, 1 episode) cannot be drawn with cartpole's returns" in told


@pytest.fixture(scope="module")
def tab(page):
    """The page in a browser, and what it asked for and complained of."""
    pytest.importorskip("playwright")
    if CHROMIUM is None:
        pytest.skip("there is no chromium")
    with chromium(page.as_uri(), "html[data-ready=true]") as (opened, said):
        opened.said = said
        yield opened


def test_somebody_goes_through_the_steps(tab, page):
    meta, arrays = data_of(page)
    tab.evaluate("document.querySelector('#steps').scrollIntoView()")

    def press(*keys):
        for key in keys:
            tab.keyboard.press(key)
        tab.wait_for_timeout(60)
        text = tab.inner_text("#where")
        return int(re.search(r"step ([\d,]+) of the run", text)[1].replace(",", ""))

    vetoes = np.flatnonzero(arrays["bits"] & 1)
    assert press() == arrays["position"][vetoes[-1]]
    assert " proposed push-" in tab.inner_text("#decision")
    first = meta["episodes"][0]
    tab.fill("#episode", "1")
    tab.press("#episode", "Enter")
    tab.evaluate("document.activeElement.blur()")
    start = press("Home")
    assert start == first["first"]
    assert press("ArrowRight", "ArrowRight", "ArrowLeft") == start + 1
    assert press("End") == start + first["steps"] - 1
    assert press("Shift+ArrowRight") == meta["episodes"][1]["first"]
    assert press("Shift+ArrowLeft") == start
    # A table shows the state that was recorded.
    shown = tab.locator("#fluents tr td:nth-child(2)").all_inner_texts()
    state = arrays["state"].reshape(len(meta["fluents"]), -1)[:, start]
    numbers = [float(text.replace("−", "-")) for text in shown if text]
    assert numbers == pytest.approx(state, rel=1e-3, abs=1e-9)
    # A filter: n goes to the next veto, p back. A card filters, too.
    tab.check("#filters input[name=kind][value='1']")
    assert press("n", "n", "p") == vetoes[vetoes > start][0]
    tab.uncheck("#filters input[name=kind][value='1']")
    tab.click("#refused button[data-card] >> nth=0")
    assert press() in arrays["position"][vetoes]
    assert re.search(r"[1-9]", tab.inner_text("#hit-count"))
    tab.click("#extra")
    # The line behind it, in the file beside.
    tab.click("#causes .unsafe button.line, #causes .reward button.line >> nth=0")
    place = tab.locator("#causes button.line >> nth=0").inner_text()
    assert tab.get_attribute("#files li.here", "id") == f"f0-{place.rpartition(':')[2]}"
    # Playing goes on; a narrow page does not scroll sideways.
    tab.select_option("#speed", "20")
    before = press("Home")
    tab.click("#play")
    tab.wait_for_timeout(500)
    assert press() > before
    tab.set_viewport_size({"width": 380, "height": 800})
    # Charts are drawn anew after the page has its new width.
    widths = []
    while len(widths) < 50 and (not widths or widths[-1] > 380):
        tab.wait_for_timeout(100)
        widths.append(tab.evaluate("document.documentElement.scrollWidth"))
    assert widths[-1] <= 380
    assert tab.said == []


def test_texts_of_the_file_are_texts(tab):
    assert tab.title() != "taken"
    assert HOSTILE in tab.locator("#files").inner_text()
    assert tab.locator("#files img").count() == 0
