// The learning curve, and who acted: drawn as SVG in the width that there is.

const MARGIN = { left: 52, right: 26, top: 10, bottom: 34 };

/** Round numbers between two values, about `count` of them. */
function ticks(low, high, count) {
  const rough = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= rough);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) found.push(k * step + 0); // no −0
  return found;
}

/** Axes in a new SVG. `x` and `y` map values to places. */
function axes(box, height, [xLow, xHigh], [yLow, yHigh], xLabel, yLabel, asShare = false) {
  const width = Math.max(280, box.clientWidth);
  const svg = element("svg:svg", { width, height, role: "img", "aria-label": box.dataset.label });
  const right = width - MARGIN.right, bottom = height - MARGIN.bottom;
  const x = (v) => MARGIN.left + (v - xLow) / (xHigh - xLow || 1) * (right - MARGIN.left);
  const y = (v) => bottom - (v - yLow) / (yHigh - yLow || 1) * (bottom - MARGIN.top);
  const add = (tag, attributes, text) => svg.appendChild(element(`svg:${tag}`, attributes, text));
  for (const v of asShare ? [0, 0.5, 1] : ticks(yLow, yHigh, 5)) {
    add("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(v), y2: y(v) });
    add("text", { class: "tick", x: MARGIN.left - 8, y: y(v) + 4, "text-anchor": "end" },
      asShare ? `${100 * v} %` : readable(v));
  }
  for (const v of ticks(xLow, xHigh, Math.min(8, width / 90))) {
    const thousands = v >= 10000 ? `${readable(v / 1000)}k` : readable(v);
    add("text", { class: "tick", x: x(v), y: bottom + 16, "text-anchor": "middle" }, thousands);
  }
  add("text", { class: "tick", x: right, y: height - 3, "text-anchor": "end" }, xLabel);
  add("title", {}, yLabel);
  const clip = add("clipPath", { id: `${box.id}-clip` });
  clip.appendChild(element("svg:rect", {
    x: MARGIN.left, y: MARGIN.top, width: right - MARGIN.left, height: bottom - MARGIN.top }));
  const plot = add("g", { "clip-path": `url(#${box.id}-clip)` });
  box.replaceChildren(svg);
  return { svg, plot, x, y, left: MARGIN.left, right };
}

const line = (xs, ys, x, y) =>
  Array.from(xs, (v, k) => `${k ? "L" : "M"}${x(v).toFixed(1)} ${y(ys[k]).toFixed(1)}`).join("");

function area(xs, low, high, x, y) {
  const back = Array.from(xs).reverse(), under = Array.from(low).reverse();
  return `${line(xs, high, x, y)}${line(back, under, x, y).replace("M", "L")}Z`;
}

function drawCurve(box) {
  const c = arrays;
  const seen = Array.from(c.curveReturns).sort((a, b) => a - b);
  const bounds = [seen[Math.floor(0.01 * seen.length)], seen[Math.floor(0.99 * (seen.length - 1))],
    ...c.mean, ...meta.others.flatMap((_, k) => [...c[`otherMean${k}`]])];
  let low = Math.min(...bounds), high = Math.max(...bounds);
  const room = 0.06 * (high - low || 1);
  [low, high] = [low - room, high + room];
  const { svg, plot, x, y, left, right } = axes(
    box, 300, [0, meta.envSteps], [low, high], "environment steps", "return of each episode");
  const add = (tag, attributes) => plot.appendChild(element(`svg:${tag}`, attributes));
  const dots = Array.from(c.curveAt, (v, k) => `M${x(v).toFixed(1)} ${y(c.curveReturns[k]).toFixed(1)}h0`);
  add("path", { class: "dots", d: dots.join("") });
  add("path", { class: "mean-band", d: area(c.curveAt, c.meanLow, c.meanHigh, x, y) });
  add("path", { class: "mean-line", d: line(c.curveAt, c.mean, x, y) });
  meta.others.forEach((_, k) => add("path", { class: `other other-${(k + 1) % 4}`,
    d: line(c[`otherAt${k}`], c[`otherMean${k}`], x, y) }));
  const mark = add("line", { class: "chosen", y1: MARGIN.top, y2: 300 - MARGIN.bottom, x1: -9, x2: -9 });
  svg.addEventListener("pointermove", (event) => {
    const k = nearest(event);
    say(byId("curve-says"), `Episode ${readable(c.curveNumbers[k])}: return ${readable(c.curveReturns[k])}, `
      + `mean ${readable(c.mean[k])}`);
    mark.setAttribute("x1", x(c.curveAt[k]));
    mark.setAttribute("x2", x(c.curveAt[k]));
  });
  svg.addEventListener("click", (event) => {
    if (!meta.training || !total()) return; // the steps are not those of the curve
    const step = nearestOf(arrays.position, c.curveAt[nearest(event)] - 1);
    jump(episodeAt(step).first);
  });
  const nearest = (event) => {
    const at = event.clientX - svg.getBoundingClientRect().left;
    return nearestOf(c.curveAt, (at - left) / (right - left) * meta.envSteps);
  };
}

/** The position of the number that is nearest to a value. */
const nearestOf = (numbers, value) => numbers.reduce((best, number, k) =>
  Math.abs(number - value) < Math.abs(numbers[best] - value) ? k : best, 0);

function drawShares(box) {
  const c = arrays, count = c.shareAt.length;
  const { plot, x, y } = axes(
    box, 170, [0, meta.envSteps], [0, 1], "environment steps", "share of the decisions", true);
  let under = new Float32Array(count);
  meta.actors.forEach((actor, a) => {
    const over = under.map((v, k) => v + c.shares[a * count + k]);
    plot.appendChild(element("svg:path", {
      class: `fill-${actor}`, d: area(c.shareAt, under, over, x, y) }));
    under = over;
  });
  if (c.rho.every(Number.isFinite)) // else there is none
    plot.appendChild(element("svg:path", { class: "rho", d: line(c.curveAt, c.rho, x, y) }));
}
