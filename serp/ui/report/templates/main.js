// The beginning: unpack the data, draw, and connect what can be clicked.

const on = (id, what, call) => byId(id).addEventListener(what, call);

function connectSteps() {
  document.addEventListener("keydown", onKey);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  on("play", "click", () => play());
  on("back", "click", () => move(-1));
  on("forward", "click", () => move(1));
  on("next-hit", "click", () => toHit(1));
  on("previous-hit", "click", () => toHit(-1));
  on("episode", "change", (event) => { play(false); show(numbered(event.target.valueAsNumber || 1).first); });
  on("episode-back", "click", () => nextEpisode(-1));
  on("episode-on", "click", () => nextEpisode(1));
  on("after", "change", (event) => { after = event.target.checked; show(now); });
  on("filters", "change", refilter);
  on("extra", "click", () => { extra = null; refilter(); });
  const choose = (event) => {
    const at = alternatives.rows.indexOf(event.target.closest("tr"));
    if (at >= 0 && (event.type === "click" || event.key === "Enter")) {
      chosen = alternatives.first + at;
      show(now);
    }
  };
  for (const row of alternatives.rows) row.tabIndex = 0;
  alternatives.body.addEventListener("click", choose);
  alternatives.body.addEventListener("keydown", choose);
  const buttons = (data, call) => document.querySelectorAll(`button[data-${data}]`).forEach(
    (button) => button.addEventListener("click", () => call(button)));
  buttons("step", (button) => jump(Number(button.dataset.step)));
  buttons("card", filterBy);
  buttons("line", (button) => { jump(now); toLine(button.dataset.line); });
}

function fit() {
  for (const [id, draw] of [["curve", drawCurve], ["shares", drawShares]]) {
    if (byId(id)) draw(byId(id));
  }
  if (total()) redraw();
}

meta = JSON.parse(byId("meta").textContent);
meta.episodes.forEach((episode, index) => { episode.index = index; });
const packed = await unpacked(byId("arrays").textContent);
arrays = arraysOf(packed, meta.layout);
sentences = new TextDecoder().decode(arrays.sentences).split("\n");
if (total()) {
  const pick = (step) => { play(false); show(step); };
  [run, inEpisode] = [new Strip(byId("run-strip"), pick), new Strip(byId("episode-strip"), pick)];
  fluents = new RowTable(byId("fluents"), ["name", "n", "n", "n", "n error"], 27,
    meta.fluents.length, fillFluent);
  alternatives = new RowTable(byId("alternatives"), ["name", "n", "n", "n", "n", "remark"], 27,
    meta.actions.length, fillAlternative);
  if (arrays.pictureAt.length > 1) scene = new Scene(byId("scene"), arrays.pictures, arrays.pictureAt);
  byId("after").parentElement.hidden = !scene;
  const asked = /^#step-(\d+)$/.exec(location.hash); // of the run, as `serp why --step`
  now = asked ? nearestOf(arrays.position, Number(asked[1])) : Math.min(meta.start, total() - 1);
  connectSteps();
}
fit();
let width = innerWidth;
addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; fit(); } });
requestAnimationFrame(() => { // after the first step was written
  const mentioned = document.querySelector(".file .used");
  if (mentioned) toLine(mentioned.id, false);
  if (location.hash.startsWith("#step-")) byId("steps").scrollIntoView();
  document.documentElement.dataset.ready = "true";
});
