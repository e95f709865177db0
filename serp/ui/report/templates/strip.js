// A timeline: a bar of the steps in the colours of who acted, marks above it, and a playhead.

class Strip {
  /** `onPick(step)` is called while somebody drags or clicks. */
  constructor(box, onPick) {
    this.box = box;
    this.canvas = box.querySelector("canvas");
    this.head = box.querySelector(".playhead");
    this.onPick = onPick;
    const pick = (event) => {
      const { left, width } = box.getBoundingClientRect();
      const share = Math.min(1, Math.max(0, (event.clientX - left) / width));
      onPick(this.first + Math.min(this.count - 1, Math.floor(share * this.count)));
    };
    box.addEventListener("pointerdown", (event) => {
      box.setPointerCapture(event.pointerId);
      pick(event);
    });
    box.addEventListener("pointermove", (event) => { if (event.buttons & 1) pick(event); });
  }

  /** Measure it: sizes that are asked for while a step is shown would cost a layout each. */
  measure() {
    [this.width, this.height] = [this.box.clientWidth, this.box.clientHeight];
  }

  /** Draw steps `first` to `first + count`; steps that are no hits are pale. */
  draw(first, count, hits, colors) {
    [this.first, this.count] = [first, count];
    const ratio = devicePixelRatio || 1, width = Math.max(1, Math.round(this.width * ratio));
    const height = Math.round(this.height * ratio);
    if (this.canvas.width !== width) [this.canvas.width, this.canvas.height] = [width, height];
    const context = this.canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    const bars = Math.min(width, count), gap = width / bars >= 5 * ratio ? ratio : 0;
    const room = Math.round(0.36 * height), counts = new Uint32Array(meta.actors.length);
    for (let k = 0; k < bars; k++) {
      const from = first + Math.floor(k * count / bars), to = first + Math.ceil((k + 1) * count / bars);
      const x = Math.floor(k * width / bars), w = Math.ceil((k + 1) * width / bars) - x - gap;
      let unsafe = 0, vetoed = 0, hit = 0, error = 0;
      counts.fill(0);
      for (let i = from; i < to; i++) {
        counts[arrays.executedBy[i]] += 1;
        vetoed += (arrays.bits[i] & VETOED) > 0;
        unsafe += (arrays.bits[i] & (UNSAFE | NO_SAFE)) > 0;
        error += (arrays.bits[i] & LARGE_ERROR) > 0;
        hit |= hits === null || hits[i];
      }
      const fill = (color, y, tall) => {
        context.fillStyle = color;
        context.fillRect(x, y, Math.max(w, 1), tall);
      };
      const share = (height - room) / (to - from);
      let y = room;
      context.globalAlpha = hit ? 1 : 0.15;
      counts.forEach((some, actor) => { fill(colors[actor], y, some * share); y += some * share; });
      const marked = (some) => some && Math.max(4 * ratio, (room - 2 * ratio) * some / (to - from));
      if (vetoed) fill(colors.vetoed, room - 2 * ratio - marked(vetoed), marked(vetoed));
      if (unsafe) fill(colors.unsafe, 0, room - 2 * ratio);
      if (error) fill(colors.error, height - 3 * ratio, 3 * ratio);
    }
  }

  place(step, text) {
    const share = (step - this.first + 0.5) / this.count;
    this.head.style.transform = `translateX(${share * this.width}px)`;
    this.box.setAttribute("aria-valuenow", step - this.first);
    this.box.setAttribute("aria-valuemax", this.count - 1);
    this.box.setAttribute("aria-valuetext", text);
  }
}
