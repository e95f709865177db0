// The drawn scene: every picture is a WebP in the packed arrays.

class Scene {
  constructor(canvas, pictures, at) {
    [this.canvas, this.pictures, this.at] = [canvas, pictures, at];
    this.bitmaps = new Map(); // of the pictures that were shown last
    this.context = canvas.getContext("2d", { alpha: false });
  }

  /** Draw a picture, at once if it is decoded. */
  async show(frame) {
    this.wanted = frame;
    let bitmap = this.bitmaps.get(frame);
    if (!bitmap) {
      const bytes = this.pictures.subarray(this.at[frame], this.at[frame + 1]);
      bitmap = await createImageBitmap(new Blob([bytes], { type: "image/webp" }));
      this.bitmaps.set(frame, bitmap);
      if (this.bitmaps.size > 64) this.bitmaps.delete(this.bitmaps.keys().next().value);
      if (this.wanted !== frame) return;
    }
    const { width, height } = bitmap;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      [this.canvas.width, this.canvas.height] = [width, height];
      this.canvas.parentElement.style.aspectRatio = Math.max(1, width / height);
    }
    this.context.drawImage(bitmap, 0, 0);
  }
}
