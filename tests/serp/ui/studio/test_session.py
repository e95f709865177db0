"""What the studio shows and saves, who is let in, and who owns it, without a browser."""

import asyncio
import os
import re

import pytest

from serp.errors import SerpError
from serp.model.domain import load_domain
from serp.planning.replanner import MonitorReplanner
from serp.runs.train import plan_and_learn
from serp.tasks.registry import load_task
from serp.ui.studio.document import Document
from serp.ui.studio.serving import Guard
from serp.ui.studio.session import open_session
from tests.worlds import text

SWITCH = text("switch")
PROBLEM = "(define (problem warm) (:domain switch) (:init (= (heat) 30.0) (= (reward) 0.0)))"


@pytest.fixture
def session(tmp_path):
    file = tmp_path / "switch.pddl"
    file.write_text(SWITCH)
    return open_session(str(file), tmp_path)


def test_a_view_says_what_the_planner_of_the_text_decides(session):
    session.values = {"heat": 20.0, "on": True, "no such fluent": 1.0}
    view = session.asked()()
    assert view.decision is not None and view.findings == ()
    domain = load_domain(session.documents["domain"].path, observed=True)
    plan = MonitorReplanner(domain.model).plan([1.0, 20.0])
    account = view.decision.account
    assert (account.chosen, account.alternatives[0].best_return) == (plan.action, plan.reward)
    session.values = {**session.values, "heat": 70.0}  # a fluent that is set
    view = session.asked()()
    (unsafe,) = (c for c in view.decision.account.alternatives[0].causes if c.what == "unsafe")
    assert unsafe.place is not None and unsafe.place.line == 8
    heat = next(each for each in view.decision.controls if each.name == "heat")
    assert heat.low <= 0.0 and heat.high >= 80.0  # the thresholds of the file
    assert heat.value == 70.0


def test_a_file_too_large_to_follow_typing_says_so_at_once(session):
    session.edit("domain", SWITCH + "(:action a :parameters () :effect (on))\n" * 30_000)
    view = session.asked()()
    assert "too large to be checked here" in view.failure and view.decision is None


def test_nothing_is_written_over_or_outside_of_the_folder(tmp_path):
    folder, outside = tmp_path / "mine", tmp_path / "theirs.pddl"
    folder.mkdir()
    outside.write_text("theirs")
    document = Document(folder / ".." / "theirs.pddl", folder)
    document.text = "mine"
    assert document.save() == folder / "theirs.pddl" and outside.read_text() == "theirs"
    (folder / "theirs.pddl").chmod(0o600)
    (folder / "theirs.pddl").write_text("changed meanwhile")
    document.text = "mine again"
    with pytest.raises(SerpError, match="save again to replace it"):
        document.save()
    document.save()
    assert (folder / "theirs.pddl").read_text() == "mine again"
    assert (folder / "theirs.pddl").stat().st_mode & 0o777 == 0o600
    document.text = "not saved"
    assert document.keep() == f"The unsaved text is kept in {folder / 'theirs.pddl.unsaved'}"
    assert (folder / "theirs.pddl.unsaved").read_text() == "not saved"
    assert (folder / "theirs.pddl").read_text() == "mine again"
    (folder / "theirs.pddl").unlink()
    os.mkfifo(folder / "theirs.pddl")
    with pytest.raises(SerpError, match="not a regular file"):  # reading it would never end
        document.save()
    (folder / "linked.pddl").symlink_to(outside)
    document = Document(folder / "linked.pddl", folder)
    document.text = "through a link"
    with pytest.raises(Exception, match="leads out of"):
        document.save()
    assert outside.read_text() == "theirs"


def test_each_text_that_was_not_saved_is_kept(tmp_path):
    outside = tmp_path.parent / f"{tmp_path.name}.pddl"
    (tmp_path / "switch.pddl").write_text(SWITCH)
    (tmp_path / "switch-problem.pddl").write_text(PROBLEM)
    session = open_session(str(tmp_path / "switch.pddl"), tmp_path)
    problem = session.documents["problem"]
    earlier = problem.target.with_name(problem.target.name + ".unsaved")
    earlier.write_text("earlier")
    session.edit("domain", "mine")
    session.edit("problem", "mine, too \ud800")  # a half of a character
    session.documents["domain"].target = outside  # cannot be written
    lost, kept = session.close()
    assert "is lost" in lost and not outside.exists()
    assert kept == f"The unsaved text is kept in {earlier}-2"
    assert earlier.read_text() == "earlier"
    assert earlier.with_name(earlier.name + "-2").read_text() == "mine, too ?"


# The guard ---------------------------------------------------------------------------------------


def answer(guard, headers, query="", kind="http", path="/"):
    """Ask a guard; return the messages of its answer, the first with what a later one says."""
    sent = []

    async def send(message):
        sent.append(message)

    async def receive():
        return {"type": "http.request"}

    scope = {
        "type": kind,
        "method": "GET",
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    asyncio.run(guard(scope, receive, send))
    return sent[0] | {"body": sent[-1].get("body", b"").decode()}


async def inside(scope, receive, send):
    kind = "http.response.start" if scope["type"] == "http" else "websocket.accept"
    await send({"type": kind, "status": 200, "headers": []})


HERE = {"host": "127.0.0.1:8000"}


def let_in(guard):
    """Hand the token over; return the cookie and the path to which it belongs."""
    welcome = answer(guard, HERE | {"sec-fetch-site": "cross-site"}, f"token={guard.token}")
    cookie = dict(welcome["headers"])[b"set-cookie"].decode()
    path = re.search(r"url=(/[^\"]+/)\"", welcome["body"])[1]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and f"Path={path[:-1]};" in cookie
    return cookie.partition(";")[0], path


def test_a_session_needs_the_cookie_and_the_secret_path_and_a_token_is_good_once():
    used = []
    guard = Guard(inside, 8000, lambda: used.append(guard.token))
    token = guard.token
    assert answer(guard, HERE)["status"] == 403
    assert answer(guard, HERE, "token=wrong")["status"] == 403
    assert answer(guard, {"host": "evil.example:8000"}, f"token={token}")["status"] == 403
    foreign = {**HERE, "origin": "http://evil.example"}
    assert answer(guard, foreign, f"token={token}")["status"] == 403 and used == []
    cookie, path = let_in(guard)
    assert used == [guard.token] != [token]
    assert answer(guard, HERE, f"token={token}")["status"] == 403
    known = {**HERE, "cookie": f"other=1; {cookie}"}
    assert answer(guard, known)["status"] == 403  # other ports of this machine know no more
    assert answer(guard, HERE, path=path)["status"] == 403
    assert answer(guard, known | {"sec-fetch-site": "same-site"}, path=path)["status"] == 403
    headers = dict(answer(guard, known | {"sec-fetch-site": "none"}, path=path)["headers"])
    assert b"connect-src 'self' ws://127.0.0.1:8000" in headers[b"content-security-policy"]


@pytest.mark.parametrize(
    ("host", "origin", "accepted"),
    [
        ("127.0.0.1:8000", "http://127.0.0.1:8000", True),
        ("localhost:8000", "http://localhost:8000", True),
        ("127.0.0.1:8000", "http://evil.example", False),
        ("127.0.0.1:8000", "null", False),
        ("127.0.0.1:8000", "http://127.0.0.1:9000", False),
        ("127.0.0.1:8000", None, False),
        ("evil.example:8000", "http://evil.example:8000", False),  # a name that leads here
    ],
)
def test_a_websocket_of_another_page_is_refused(host, origin, accepted):
    guard = Guard(inside, 8000)
    cookie, path = let_in(guard)
    headers = {"host": host, "cookie": cookie} | ({} if origin is None else {"origin": origin})
    found = answer(guard, headers, kind="websocket", path=path)["type"] == "websocket.accept"
    assert found == accepted
    del headers["cookie"]
    assert answer(guard, headers, kind="websocket", path=path)["type"] == "websocket.close"


# Runs --------------------------------------------------------------------------------------------


def test_a_run_is_opened_with_its_copy_of_the_file(tmp_path):
    task = load_task("cartpole")
    run = plan_and_learn(task, env_steps=30, seed=1, out=tmp_path / "run", quiet=True)
    of_run = open_session(str(run.path), tmp_path / "elsewhere")
    assert of_run.documents["domain"].target == tmp_path / "elsewhere" / "cartpole.pddl"
    assert of_run.task is not None and of_run.surroundings.dt == task.dt
    assert of_run.asked()().decision is not None and of_run.begins_with_episode
    at_step = open_session(str(run.path), tmp_path, step=7)
    recorded = run.recording().step(7)
    assert at_step.values == run.domain.model.values(recorded.state) and "step 7" in at_step.origin
    assert not at_step.begins_with_episode and not at_step.by_hand
    with pytest.raises(SerpError, match="a step of a run"):
        open_session(str(run.path / "domain.pddl"), tmp_path, step=7)
