// The drawn scene: every picture is a grid of tiles, which lie in sheets; equal tiles lie there once.

class Scene {
  constructor(canvas, info, grids, sheets) {
    this.info = info;
    this.canvas = canvas;
    this.sheets = sheets; // base64 of each sheet, and later its bitmap
    this.bitmaps = new Map();
    this.shown = null;
    this.perFrame = info.columns * info.rows;
    this.perSheet = info.sheet * info.sheet;
    this.grids = grids;
    for (let k = this.perFrame; k < grids.length; k++) grids[k] += grids[k - this.perFrame];
    canvas.width = info.width;
    canvas.height = info.height;
    this.context = canvas.getContext("2d", { alpha: false });
  }

  /** Draw a picture, at once if its sheets are there, else when they have been decoded. */
  show(frame) {
    this.wanted = frame;
    const { columns, tile, sheet } = this.info;
    const own = this.grids.subarray(frame * this.perFrame, (frame + 1) * this.perFrame);
    const missing = new Set();
    for (const tileId of own) {
      const at = Math.floor(tileId / this.perSheet);
      if (!this.bitmaps.has(at)) missing.add(at);
    }
    if (missing.size) {
      Promise.all(Array.from(missing, (at) => this.decode(at))).then(() => {
        if (this.wanted === frame) this.show(frame);
      });
      return;
    }
    for (let k = 0; k < own.length; k++) {
      if (this.shown && this.shown[k] === own[k]) continue;
      const at = own[k] % this.perSheet;
      this.context.drawImage(this.bitmaps.get(Math.floor(own[k] / this.perSheet)),
        (at % sheet) * tile, Math.floor(at / sheet) * tile, tile, tile,
        (k % columns) * tile, Math.floor(k / columns) * tile, tile, tile);
    }
    this.shown = own;
  }

  async decode(at) {
    if (typeof this.sheets[at] === "string") {
      const blob = new Blob([decoded(this.sheets[at])], { type: "image/webp" });
      this.sheets[at] = createImageBitmap(blob);
    }
    this.bitmaps.set(at, await this.sheets[at]);
  }
}
