// The recorded steps: one of them is shown, with the scene, the state, the decision and the file.

const [VETOED, NO_SAFE, UNSAFE, LARGE_ERROR] = [1, 2, 4, 8]; // as `kinds` in report.py
const [APPLICABLE, IS_UNSAFE, TERMINAL, UNDEFINED, RISKY, UNMODELLED] = [1, 2, 4, 8, 16, 128];
const NONE = 0xffff, SAFE = 0xfffe;

let arrays, sentences, scene = null, fluents, alternatives, run, inEpisode;
let now = -1, chosen = -1, shownEpisode = null, queued = false, playing = null;
let hits = null, hitList = null, extra = null, after = false, colors = null;

const total = () => meta.steps;

const episodeAt = (step) => meta.episodes.findLast((episode) => episode.first <= step);

/** Go to a step; what it shows is written once a frame, however many come. */
function show(step) {
  step = Math.max(0, Math.min(total() - 1, step));
  if (step !== now) chosen = -1;
  now = step;
  if (!queued) {
    queued = true;
    requestAnimationFrame(paint);
  }
}

function paint() {
  queued = false;
  const episode = episodeAt(now), k = now - episode.first;
  if (episode !== shownEpisode) enter(episode);
  if (chosen < 0) {
    const refused = arrays.bits[now] & VETOED && arrays.proposed[now] !== NONE;
    chosen = refused ? arrays.proposed[now] : arrays.executed[now];
  }
  const time = (k * meta.dt).toFixed(meta.dt < 0.1 ? 2 : 1);
  say(byId("where"), `Step ${k} of ${episode.steps - 1} · ${time} s · step ${readable(
    arrays.position[now])} of the run`);
  run.place(now, `episode ${episode.number}, step ${k}`);
  inEpisode.place(now, `step ${k} of ${episode.steps - 1}`);
  paintScene(episode, k);
  fluents.paint();
  alternatives.paint();
  say(byId("decision"), sentences[arrays.sentence[now]]);
  const actor = meta.actors[arrays.executedBy[now]];
  byId("actor").className = `actor back-${actor}`;
  say(byId("actor"), actor);
  say(byId("executed"), meta.actions[arrays.executed[now]]);
  paintCauses();
  const at = hitList && nearestOf(hitList, now);
  say(byId("hit-count"), hitList === null ? "" : hits[now]
    ? `${readable(at + 1)} of ${readable(hitList.length)}` : `${readable(hitList.length)} steps`);
}

function paintScene(episode, k) {
  const drawn = scene && k + (after ? 1 : 0) < episode.frames;
  byId("scene").hidden = !drawn;
  byId("no-scene").hidden = Boolean(drawn);
  if (drawn) scene.show(episode.frame + k + (after ? 1 : 0));
  else say(byId("no-scene"), episode.note || "There is no picture of this step.");
}

function enter(episode) {
  shownEpisode = episode;
  byId("episode").value = episode.number;
  inEpisode.draw(episode.first, episode.steps, hits, colors);
  say(byId("outcome"), `return ${readable(episode.return)}, ${episode.end}, ${episode.vetoes
    ? `${episode.vetoes} vetoed` : "no veto"}`);
}

const lastOf = (episode) => episode.first + episode.steps - 1;

/** The value of a fluent that was observed after a step. */
function observed(f, step, episode) {
  if (step < lastOf(episode)) return arrays.state[f * total() + step + 1];
  return arrays.last[f * meta.episodes.length + episode.index];
}

const isWrong = (f, error) => error >= (meta.fluents[f].numeric ? meta.largeError : 1);

const valueOf = (f, v) => meta.fluents[f].numeric || Number.isNaN(v) ? compact(v)
  : v > 0.5 ? "true" : "false";

function fillFluent(cells, row, f) {
  const before = arrays.state[f * total() + now], predicted = arrays.predicted[f * total() + now];
  const next = observed(f, now, shownEpisode), error = arrays.errors[f * total() + now];
  say(cells[0], meta.fluents[f].name);
  cells[0].title = meta.fluents[f].name; // where the column is too narrow
  say(cells[1], valueOf(f, before));
  say(cells[2], valueOf(f, predicted));
  say(cells[3], valueOf(f, next));
  say(cells[4], Number.isNaN(error) ? "–" : error < 0.05 ? "" : error.toFixed(error < 10 ? 1 : 0));
  const state = `${Math.abs(next - before) > 1e-9 ? "changed " : ""}${
    isWrong(f, error) ? "wrong" : ""}`;
  if (row.className !== state) row.className = state;
}

function fillAlternative(cells, row, a) {
  const at = a * total() + now, flags = arrays.flags[at], safe = arrays.safe[at];
  const remarks = [];
  if (flags & IS_UNSAFE) remarks.push("unsafe");
  if (flags & RISKY) remarks.push("too risky");
  if (flags & UNDEFINED) remarks.push("no defined result");
  else if (flags & UNMODELLED) remarks.push("not in the file");
  else if (!(flags & APPLICABLE)) remarks.push("not applicable");
  if (flags & TERMINAL) remarks.push("ends the task");
  const applicable = flags & APPLICABLE;
  say(cells[0], meta.actions[a]);
  cells[0].title = meta.actions[a];
  say(cells[1], applicable ? compact(arrays.value[at]) : "–");
  say(cells[2], applicable ? compact(arrays.reward[at]) : "–");
  say(cells[3], applicable ? percent(arrays.risk[at]) : "–");
  say(cells[4], safe === SAFE ? "all" : safe === NONE ? "–" : readable(safe));
  say(cells[5], remarks.join(", "));
  cells[5].title = remarks.join(", ");
  const executed = a === arrays.executed[now], proposed = a === arrays.proposed[now];
  const refused = proposed && arrays.bits[now] & VETOED && !executed;
  const state = `${executed ? "taken " : ""}${refused ? "refused " : ""}${
    a === chosen ? "chosen" : ""}`;
  if (row.className !== state) row.className = state;
  row.ariaCurrent = String(a === chosen);
}

function paintCauses() {
  const list = byId("causes"), found = [];
  for (let k = arrays.causeAt[now]; k < arrays.causeAt[now + 1]; k++) {
    if (arrays.causeAction[k] === chosen) found.push(k);
  }
  const key = found.map((k) => `${arrays.cause[k]}:${arrays.amount[k]}`).join() + `@${chosen}`;
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  say(byId("causes-of"), `What the file says about ${meta.actions[chosen]}, one step ahead`);
  list.replaceChildren(...found.map(causeItem));
  const explained = chosen === arrays.executed[now] || chosen === arrays.proposed[now];
  if (!found.length) list.append(element("li", { class: "quiet" }, explained
    ? "No reward, end or flag." : "Only the executed and the refused action are explained; "
      + `serp why --step ${arrays.position[now]} explains all, and serp studio --step opens the step.`));
  const lines = new Set(found.map((k) => meta.causes[arrays.cause[k]].line));
  for (const old of document.querySelectorAll(".file li.used")) old.classList.remove("used");
  for (const id of lines) if (id) byId(id).classList.add("used");
}

function causeItem(k) {
  const cause = meta.causes[arrays.cause[k]], amount = arrays.amount[k];
  const item = element("li", { class: `cause ${cause.kind}` });
  const what = cause.kind === "reward" ? `${amount > 0 ? "+" : ""}${readable(amount)}`
    : cause.kind === "risk" ? `${percent(amount)} risk` : cause.label;
  item.append(element("b", {}, what), ` ${cause.by}`);
  if (cause.line) {
    const go = element("button", { class: "line", type: "button" }, cause.place);
    go.addEventListener("click", () => toLine(cause.line));
    item.append(" ", go);
  }
  if (cause.comment) item.append(element("q", {}, cause.comment));
  if (cause.text) item.append(element("code", {}, cause.text));
  if (cause.condition) item.append(element("small", {}, " when "), element("code", {}, cause.condition));
  return item;
}

/** Show a line of a file in its box, and scroll the page if that is out of sight. */
function toLine(id, scroll = true) {
  const row = byId(id), box = byId("files");
  for (const old of box.querySelectorAll(".here")) old.classList.remove("here");
  row.classList.add("here");
  const down = row.getBoundingClientRect().top - box.getBoundingClientRect().top;
  box.scrollTop += down - box.clientHeight / 3;
  if (scroll) row.scrollIntoView({ block: "nearest" });
}

/** The recorded episode of that number, else the next one. */
const numbered = (number) =>
  meta.episodes.find((each) => each.number >= number) || meta.episodes.at(-1);

/** Go to a step from elsewhere on the page. */
function jump(step) {
  show(step);
  const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
  byId("steps").scrollIntoView({ behavior: calm ? "auto" : "smooth" });
}

// Filters ------------------------------------------------------------------------------------

/** Steps that are hits: of any of the kinds that are on, by any of the actors that are on. */
function refilter() {
  let kinds = 0, actors = 0;
  for (const box of document.querySelectorAll("#filters input:checked")) {
    if (box.name === "kind") kinds |= Number(box.value); else actors |= 1 << Number(box.value);
  }
  byId("extra").hidden = extra === null;
  if (extra) say(byId("extra-says"), extra.says);
  if (!kinds && !actors && !extra) [hits, hitList] = [null, null];
  else {
    hits = new Uint8Array(total());
    for (let i = 0; i < total(); i++) {
      hits[i] = (!kinds || arrays.bits[i] & kinds) && (!actors || actors >> arrays.executedBy[i] & 1)
        && (!extra || arrays.card[i] === extra.card) ? 1 : 0;
    }
    hitList = Uint32Array.from(hits.keys()).filter((i) => hits[i]);
  }
  for (const id of ["next-hit", "previous-hit"]) byId(id).disabled = !hitList || !hitList.length;
  redraw();
}

function redraw() {
  colors = currentColors();
  for (const strip of [run, inEpisode]) strip.measure();
  run.draw(0, total(), hits, colors);
  shownEpisode = null;
  show(now);
}

/** The colours of the style sheet, which canvases have to be told. */
function currentColors() {
  const probe = document.body.appendChild(element("span"));
  const of = (name) => {
    probe.className = `back-${name}`;
    return getComputedStyle(probe).backgroundColor;
  };
  const found = Object.assign(meta.actors.map(of),
    { vetoed: of("vetoed"), unsafe: of("unsafe"), error: of("error") });
  probe.remove();
  return found;
}

function toHit(direction) {
  if (!hitList || !hitList.length) return;
  const beyond = direction > 0 ? hitList.find((i) => i > now) : hitList.findLast((i) => i < now);
  if (beyond !== undefined) show(beyond);
}

/** The filter that a card sets: its vetoes. */
function filterBy(button) {
  extra = { says: button.dataset.says, card: Number(button.dataset.card) };
  refilter();
  if (hitList.length) jump(hitList[0]);
}

// Playing ------------------------------------------------------------------------------------

function play(on = playing === null) {
  if (playing !== null) cancelAnimationFrame(playing.frame);
  playing = null;
  if (on) {
    const end = now >= lastOf(episodeAt(now)) ? Math.min(now + 1, total() - 1) : now;
    playing = { from: end, since: performance.now(), frame: 0 };
    const tick = (time) => {
      const rate = Number(byId("speed").value) / meta.dt;
      const step = playing.from + Math.floor((time - playing.since) / 1000 * rate);
      const last = lastOf(episodeAt(playing.from));
      show(Math.min(Math.max(step, playing.from), last));
      if (step >= last) play(false);
      else playing.frame = requestAnimationFrame(tick);
    };
    playing.frame = requestAnimationFrame(tick);
  }
  byId("play").setAttribute("aria-pressed", String(playing !== null));
  say(byId("play"), playing === null ? "▶ Play" : "❚❚ Pause");
}

const move = (by) => { play(false); show(now + by); };

function nextEpisode(by) {
  play(false);
  const at = episodeAt(now).index + by;
  if (at >= 0 && at < meta.episodes.length) show(meta.episodes[at].first);
}

const KEYS = {
  "ArrowRight": () => move(1),
  "ArrowLeft": () => move(-1),
  "Shift+ArrowRight": () => nextEpisode(1),
  "Shift+ArrowLeft": () => nextEpisode(-1),
  "Home": () => move(episodeAt(now).first - now),
  "End": () => move(lastOf(episodeAt(now)) - now),
  " ": () => play(),
  "n": () => toHit(1),
  "p": () => toHit(-1),
  "a": () => byId("after").click(),
};

function onKey(event) {
  const target = event.target, name = (event.shiftKey && event.key.length > 1 ? "Shift+" : "") + event.key;
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (target.matches("select, input[type=number]")) return;
  if (event.key === " " && target.matches("button, input, a")) return;
  const { top, bottom } = byId("steps").getBoundingClientRect();
  const seen = top < 0.7 * innerHeight && bottom > 0.2 * innerHeight;
  if (!KEYS[name] || !seen) return;
  event.preventDefault();
  KEYS[name]();
}
