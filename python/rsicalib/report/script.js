// The switchboard of a report: shows the fit that the switches choose. Opens what is folded for
// a printer. Writes text and numbers only, never markup.
"use strict";
(() => {
  const each = (query, act) => document.querySelectorAll(query).forEach(act);
  const folded = [];
  window.addEventListener("beforeprint", () => each("details:not([open])", (part) => {
    folded.push(part);
    part.open = true;
  }));
  window.addEventListener("afterprint", () => folded.splice(0).forEach((part) => {
    part.open = false;
  }));

  const source = document.getElementById("switchboard-data");
  if (!source) return;
  const { fits, poses, equations } = JSON.parse(source.textContent);
  const boxes = [...document.querySelectorAll("#switches input")];
  const full = fits[fits.length - 1];
  const write = (cell, text, before) => {
    cell.textContent = text;
    cell.classList.toggle("changed", text !== before);
  };

  const show = () => {
    const number = boxes.reduce((sum, box) => sum + (box.checked ? 1 << box.dataset.bit : 0), 0);
    const fit = fits[number];
    each("[data-error]", (cell) => {
      write(cell, fit.error[cell.dataset.error], full.error[cell.dataset.error]);
    });
    each("[data-value]", (cell) => {
      const k = cell.dataset.value;
      write(cell, fit.parameters[k][0], full.parameters[k][0]);
    });
    each("[data-half]", (cell) => {
      const k = cell.dataset.half;
      write(cell, fit.parameters[k][1], full.parameters[k][1]);
    });
    each("#switched svg", (picture) => {
      const scale = picture.querySelector(".scale").dataset;
      const [zero, unit, bound] = [+scale.zero, +scale.unit, +scale.bound];
      picture.querySelectorAll("[data-k]").forEach((dot) => {
        const value = fit.residuals[dot.dataset.k];
        const inside = Math.max(-bound, Math.min(bound, value));
        dot.setAttribute("cy", (zero + unit * inside).toFixed(1));
        dot.classList.toggle("far", Math.abs(value) > 3.3);
        const said = dot.querySelector("title");
        said.textContent = said.textContent.replace(/: [^:]*$/, `: ${value.toFixed(2)}`);
      });
    });
    each("#mechanism [data-p]", (dot) => {
      if (!poses) return;
      const row = fit.residuals.slice(dot.dataset.p * equations, (+dot.dataset.p + 1) * equations);
      const size = Math.sqrt(row.reduce((sum, r) => sum + r * r, 0) / row.length);
      dot.setAttribute("class", `heat${(size > 1.5) + (size > 3)}`);
      const said = dot.querySelector("title");
      said.textContent = said.textContent.replace(/[^ ]* σ$/, `${size.toFixed(1)} σ`);
    });
    const off = boxes.filter((box) => !box.checked).length;
    const words = `${off} of ${boxes.length} switches off: χ² / degrees of freedom ${fit.error[0]}.`;
    document.getElementById("switched-words").textContent =
      off ? words : "All switches are on.";
    document.body.dataset.fit = String(number);
  };
  boxes.forEach((box) => box.addEventListener("change", show));
  boxes.forEach((box) => { box.checked = true; });
  show();
})();
