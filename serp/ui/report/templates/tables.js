// Tables of which only the rows in sight are in the document, however many there are.

class RowTable {
  /** `columns`: class of each cell. `fill(cells, row, k)` writes the texts of row `k`. */
  constructor(body, columns, height, count, fill) {
    this.body = body;
    this.fill = fill;
    this.count = count;
    this.height = height;
    this.box = body.closest(".scroll");
    this.before = body.appendChild(element("tr", { "aria-hidden": "true" }));
    this.rows = Array.from({ length: Math.min(count, 60) }, () => {
      const row = element("tr");
      for (const name of columns) row.appendChild(element("td", { class: name }));
      return body.appendChild(row);
    });
    this.after = body.appendChild(element("tr", { "aria-hidden": "true" }));
    this.first = 0;
    this.box.addEventListener("scroll", () => this.paint(), { passive: true });
  }

  paint() {
    const hidden = this.count - this.rows.length;
    this.first = Math.max(0, Math.min(hidden, Math.floor(this.box.scrollTop / this.height) - 10));
    if (hidden > 0) {
      this.before.style.height = `${this.first * this.height}px`;
      this.after.style.height = `${(hidden - this.first) * this.height}px`;
    }
    this.rows.forEach((row, k) => this.fill(row.cells, row, this.first + k));
  }
}
