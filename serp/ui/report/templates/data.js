// The data of the report: JSON, and arrays that are packed as gzip in base64.
"use strict";

let meta;
const byId = (id) => document.getElementById(id);

async function unpacked(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const KINDS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array };

/** Return name → typed array. */
function arraysOf(bytes, layout) {
  const arrays = {};
  let at = 0;
  for (const [name, kind, count] of layout) {
    const end = at + count * KINDS[kind].BYTES_PER_ELEMENT;
    arrays[name] = new KINDS[kind](bytes.slice(at, end).buffer);
    at = end;
  }
  return arrays;
}

/** A number with four significant digits, as everywhere in serp. */
function readable(value) {
  if (Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value < 0 ? "−∞" : "∞";
  const size = Math.abs(value);
  const text = Number.isInteger(value) || (size >= 1e3 && size < 1e9)
    ? Math.round(value).toLocaleString("en-US") : String(Number(value.toPrecision(4)));
  return text.replace("-", "−");
}

/** The same in few characters, for narrow columns. */
function compact(value) {
  const size = Math.abs(value);
  if (size > 0 && size < 1e-3) return value.toExponential(1).replaceAll("-", "−");
  return size < 0.1 ? readable(Number(value.toPrecision(3))) : readable(value);
}

/** A share in per cent, as everywhere in serp. */
function percent(share) {
  const value = 100 * share;
  if (value > 0 && value < 0.01) return "< 0.01 %";
  return `${value >= 10 ? Math.round(value) : Number(value.toPrecision(2))} %`;
}

function element(tag, attributes = {}, text = null) {
  const made = tag.startsWith("svg:")
    ? document.createElementNS("http://www.w3.org/2000/svg", tag.slice(4))
    : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== null) made.textContent = text;
  return made;
}

/** Change a text only where it differs: the document is laid out again for nothing else. */
function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
