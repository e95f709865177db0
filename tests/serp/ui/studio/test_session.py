"""What the studio shows and saves, who is let in, and who owns it, without a browser."""

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest
from nicegui import Client, ui
from nicegui.testing import user_simulation

from serp.errors import SerpError
from serp.model.domain import load_domain
from serp.planning.replanner import MonitorReplanner
from serp.runs.train import plan_and_learn
from serp.tasks.registry import load_task
from serp.ui.studio.document import Document
from serp.ui.studio.episodes import play
from serp.ui.studio.pages.page import show_page
from serp.ui.studio.serving import Guard
from serp.ui.studio.session import DOMAIN, Session, open_session
from serp.ui.studio.view import ShownState, Surroundings

DOMAINS = Path(__file__).resolve().parents[4] / "domains"
SWITCH = """(define (domain switch)
  (:requirements :strips :numeric-fluents :time)
  (:predicates (on) (unsafe) (terminal))
  (:functions (heat) (reward))
  (:action press :parameters () :precondition (and (< (heat) 80.0))
    :effect (and (on) (increase (heat) 10.0) (increase (reward) 1.0)))
  (:event burns :parameters () :precondition (and (on) (> (heat) 75.0))
    :effect (and (unsafe) (terminal))))
"""

PROBLEM = """(define (problem warm) (:domain switch) (:init (= (heat) 30.0) (= (reward) 0.0)))
"""


@pytest.fixture
def session(tmp_path: Path) -> Session:
    file = tmp_path / "switch.pddl"
    file.write_text(SWITCH)
    return open_session(str(file), tmp_path)


def test_a_view_says_what_the_planner_of_the_text_decides(session: Session) -> None:
    session.shown = ShownState({"heat": 20.0, "on": True, "no such fluent": 1.0})
    view = session.request().view()
    assert view.decision is not None and view.findings == ()
    domain = load_domain(session.documents["domain"].path, observed=True)
    plan = MonitorReplanner(domain.model).plan([1.0, 20.0])
    account = view.decision.account
    assert (account.chosen, account.alternatives[0].best_return) == (plan.action, plan.reward)
    session.set_fluent("heat", 70.0)  # a fluent that is set
    view = session.request().view()
    assert view.decision is not None
    (unsafe,) = (c for c in view.decision.account.alternatives[0].causes if c.what == "unsafe")
    assert unsafe.place is not None and unsafe.place.line == 8
    heat = next(each for each in view.decision.controls if each.name == "heat")
    assert heat.low <= 0.0 and heat.high >= 80.0  # the thresholds of the file
    assert heat.value == 70.0


def test_a_mistake_is_placed_and_leaves_what_was_edited(session: Session) -> None:
    session.edit("domain", SWITCH.replace("(heat) 10.0", "(heet) 10.0"))
    view = session.request().view()
    assert view.decision is None
    (error,) = (finding for finding in view.findings if finding.severity == "error")
    assert error.place is not None and (error.place.line, error.place.text) == (6, "heet")


def test_an_episode_gives_states_pictures_and_ranges(tmp_path: Path) -> None:
    session = open_session(str(DOMAINS / "cartpole.pddl"), tmp_path)
    assert session.task is not None and session.surroundings.dt == load_task("cartpole").dt
    session.take(play(session.task, session.version, session.surroundings, 3))
    assert session.played is not None and session.as_played and session.step is not None
    step = session.played.steps[session.step]
    assert step.picture.startswith("data:image/webp;base64,") and not step.indifferent
    view = session.request().view()
    assert view.decision is not None and view.drawing.startswith("<svg")
    taken = view.decision.account.taken
    assert taken is not None and step.action == f"planner: {taken.name}"
    session.set_fluent("pole-angle", 0.25)
    assert not session.as_played and session.request().view().drawing != view.drawing


@pytest.mark.parametrize("encoded", [b"one\r\ntwo\r\n", "\ufeffone\ntwo\n".encode()])
def test_saving_keeps_line_ends_and_byte_order_mark(tmp_path: Path, encoded: bytes) -> None:
    file = tmp_path / "a.pddl"
    file.write_bytes(encoded)
    document = Document(file, tmp_path)
    assert document.text == "one\ntwo\n"
    document.text = document.text.replace("two", "three")
    assert document.changed and document.save() == file and not document.changed
    assert file.read_bytes() == encoded.replace(b"two", b"three")


def test_nothing_is_written_over_or_outside_of_the_folder(tmp_path: Path) -> None:
    folder, outside = tmp_path / "mine", tmp_path / "theirs.pddl"
    folder.mkdir()
    outside.write_text("theirs")
    document = Document(folder / ".." / "theirs.pddl", folder)
    document.text = "mine"
    assert document.save() == folder / "theirs.pddl" and outside.read_text() == "theirs"
    (folder / "theirs.pddl").write_text("changed meanwhile")
    document.text = "mine again"
    with pytest.raises(SerpError, match="save again to replace it"):
        document.save()
    document.save()
    assert (folder / "theirs.pddl").read_text() == "mine again"
    document.text = "not saved"
    assert document.keep() == f"The unsaved text is kept in {folder / 'theirs.pddl.unsaved'}"
    assert (folder / "theirs.pddl.unsaved").read_text() == "not saved"
    assert (folder / "theirs.pddl").read_text() == "mine again"
    (folder / "theirs.pddl").unlink()
    os.mkfifo(folder / "theirs.pddl")
    with pytest.raises(SerpError, match="no regular file"):  # reading it would never end
        document.save()
    (folder / "linked.pddl").symlink_to(outside)
    document = Document(folder / "linked.pddl", folder)
    document.text = "through a link"
    with pytest.raises(Exception, match="leads out of"):
        document.save()
    assert outside.read_text() == "theirs"


def test_a_page_that_opens_shows_what_other_programs_wrote_unless_something_is_not_saved(
    tmp_path: Path,
) -> None:
    file = tmp_path / "a.pddl"
    file.write_text("one\n")
    session = Session(Document(file, tmp_path), None, Surroundings())
    file.write_text("two\n")
    session.take_over(lambda: None)
    assert session.documents[DOMAIN].text == "two\n"
    session.edit(DOMAIN, "mine\n")
    file.write_text("three\n")
    session.take_over(lambda: None)
    assert session.documents[DOMAIN].text == "mine\n"


def test_a_problem_moves_with_its_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    theirs, mine = tmp_path / "theirs", tmp_path / "mine"
    for folder in (theirs, mine):
        folder.mkdir()
    (theirs / "switch.pddl").write_text(SWITCH)
    (theirs / "switch-problem.pddl").write_text(PROBLEM)
    monkeypatch.chdir(mine)
    session = open_session("../theirs/switch.pddl", mine)
    session.edit("domain", SWITCH + "; mine\n")
    assert session.save() == [mine / "switch.pddl", mine / "switch-problem.pddl"]


def test_each_text_that_was_not_saved_is_kept(tmp_path: Path) -> None:
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


def answer(guard: Guard, headers: dict[str, str], query: str = "", kind: str = "http") -> Any:
    """Ask a guard; return the first message of its answer."""
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.request"}

    scope = {
        "type": kind,
        "method": "GET",
        "path": "/",
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    asyncio.run(guard(scope, receive, send))
    return sent[0]


async def inside(scope: Any, receive: Any, send: Any) -> None:
    kind = "http.response.start" if scope["type"] == "http" else "websocket.accept"
    await send({"type": kind, "status": 200, "headers": []})


def test_only_the_browser_with_the_token_is_let_in() -> None:
    guard = Guard(inside, 8000)
    here = {"host": "127.0.0.1:8000"}
    assert answer(guard, here)["status"] == 403
    assert answer(guard, here, "token=wrong")["status"] == 403
    assert answer(guard, {"host": "evil.example:8000"}, f"token={guard.token}")["status"] == 403
    foreign = {**here, "origin": "http://evil.example"}
    assert answer(guard, foreign, f"token={guard.token}")["status"] == 403
    welcome = answer(guard, here, f"token={guard.token}")
    cookie = dict(welcome["headers"])[b"set-cookie"].decode()
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie
    known = {**here, "cookie": f"other=1; {cookie.partition(';')[0]}"}
    headers = dict(answer(guard, known)["headers"])
    assert b"connect-src 'self' ws://127.0.0.1:8000" in headers[b"content-security-policy"]


@pytest.mark.parametrize(
    ("host", "origin", "let_in"),
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
def test_a_websocket_of_another_page_is_refused(
    host: str, origin: str | None, let_in: bool
) -> None:
    guard = Guard(inside, 8000)
    welcome = answer(guard, {"host": "127.0.0.1:8000"}, f"token={guard.token}")
    cookie = dict(welcome["headers"])[b"set-cookie"].decode().partition(";")[0]
    headers = {"host": host, "cookie": cookie} | ({} if origin is None else {"origin": origin})
    accepted = answer(guard, headers, kind="websocket")["type"] == "websocket.accept"
    assert accepted == let_in
    del headers["cookie"]
    assert answer(guard, headers, kind="websocket")["type"] == "websocket.close"


# Runs, tabs -------------------------------------------------------------------------------------


def test_a_run_is_opened_with_its_copy_of_the_file(tmp_path: Path) -> None:
    task = load_task("cartpole")
    run = plan_and_learn(task, env_steps=30, seed=1, out=tmp_path / "run", quiet=True)
    of_run = open_session(str(run.path), tmp_path / "elsewhere")
    assert of_run.documents["domain"].target == tmp_path / "elsewhere" / "cartpole.pddl"
    assert of_run.task is not None and of_run.surroundings.dt == task.dt
    assert of_run.request().view().decision is not None


def test_only_the_tab_that_came_last_changes_the_session(tmp_path: Path) -> None:
    session = open_session(str(DOMAINS / "hill.pddl"), tmp_path)

    async def take_turns() -> None:
        async with user_simulation(root=lambda: show_page(session)) as user:
            await user.http_client.get("/")  # a tab without its websocket
            (away,) = Client.instances.values()
            editor = next(e for e in away.elements.values() if isinstance(e, ui.codemirror))
            await user.open("/")
            assert session.owner == 2
            assert editor.id not in away.elements  # what it still sends finds nobody
            assert any(
                isinstance(each, ui.button) and each.text == "Use it here"
                for each in away.elements.values()
            )
            here = (
                each for each in user.client.elements.values() if isinstance(each, ui.codemirror)
            )
            next(here).set_value("; mine")
            assert session.documents["domain"].text == "; mine"

    asyncio.run(take_turns())
