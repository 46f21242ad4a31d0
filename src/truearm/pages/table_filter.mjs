// Rows of a table that have the words a reader types, the first of them: ten thousand rows need not be laid out.
(() => {
"use strict";
const SHOWN = 300;
for (const table of document.querySelectorAll("table.filtered")) {
  const line = table.closest(".table").querySelector(".filter");
  const [input, output] = [line.querySelector("input"), line.querySelector("output")];
  const rows = [...table.tBodies[0].rows];
  let texts = null;
  const show = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    if (words.length) texts ??= rows.map((row) => [...row.cells].map((cell) => cell.textContent).join(" ").toLowerCase());
    let found = 0;
    rows.forEach((row, i) => {
      const has = words.every((word) => texts[i].includes(word));
      row.classList.toggle("shown", has && ++found <= SHOWN);
    });
    output.value = `${found} of ${rows.length} rows` + (found > SHOWN ? `, the first ${SHOWN} are shown` : "");
  };
  line.hidden = false;
  input.addEventListener("input", show);
  show();
}
})();
