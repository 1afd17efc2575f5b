// The hypotheses and the switches of a report: shows the fit that is chosen, in every picture and
// table. Writes text and numbers only, never markup.
"use strict";
(() => {
  const source = document.getElementById("switchboard-data");
  if (!source) return;
  const each = (query, act) => document.querySelectorAll(query).forEach(act);
  const { fits, hypotheses, poses, equations, named, edges } = JSON.parse(source.textContent);
  const boxes = [...document.querySelectorAll("#switches input")];
  const choices = [...document.querySelectorAll("#hypotheses input")];
  const fader = document.getElementById("fader");
  const status = document.getElementById("switched-words");
  const full = fits[fits.length - 1] || hypotheses[named];
  // The same fit; the hypothesis knows the error at check poses as well.
  if (hypotheses.length) full.error = hypotheses[named].error;
  each("[data-now]", (cell) => { cell.dataset.now = cell.textContent; });
  const shade = (sd) => edges.filter((edge) => edge <= sd).length;
  const write = (cell, text, before) => {
    cell.textContent = text;
    cell.classList.toggle("changed", text !== before);
  };

  let touched = false;
  const show = (fit, words) => {
    each("[data-error]", (cell) => {
      write(cell, fit.error[cell.dataset.error] || "–", full.error[cell.dataset.error] || "–");
    });
    each("[data-now]", (cell) => {
      const now = fit.error[3];
      // The calibration is without what was found and is not applied; what is chosen is with it.
      const same = now === full.error[3] && !(touched && "kept" in cell.dataset);
      write(cell, same ? cell.dataset.now : now || "–", cell.dataset.now);
    });
    [["value", 0], ["half", 1]].forEach(([kind, at]) => each(`[data-${kind}]`, (cell) => {
      const of = (one) => (one.parameters[cell.dataset[kind]] || ["–", "–"])[at];
      write(cell, of(fit), of(full));
    }));
    // What neither model has is no row.
    each("[data-value]", (cell) => {
      const has = (one) => one.parameters[cell.dataset.value];
      cell.parentElement.hidden = !has(fit) && !has(full);
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
        if (said) said.textContent = said.textContent.replace(/: [^:]*$/, `: ${value.toFixed(2)}`);
      });
    });
    each("#mechanism circle[data-p]", (dot) => {
      if (!poses) return;
      const row = fit.residuals.slice(dot.dataset.p * equations, (+dot.dataset.p + 1) * equations);
      const size = Math.sqrt(row.reduce((sum, r) => sum + r * r, 0) / row.length);
      dot.setAttribute("class", `heat${(size > 1.5) + (size > 3)}`);
      const said = dot.querySelector("title");
      if (said) said.textContent = said.textContent.replace(/[^ ]* σ$/, `${size.toFixed(1)} σ`);
    });
    status.textContent = words;
    const other = fit !== full && fit !== hypotheses[named];
    each("[data-law]", (law) => {
      const own = !fit.laws || fit.laws.includes(law.dataset.law);
      law.classList.toggle("unchosen", other && !own);
      law.classList.toggle("picked", other && own && Boolean(fit.laws));
    });
    each("#workspace .contour", (part) => part.classList.toggle("unchosen", other && fit.sd));
    each("#workspace [data-w]", (cell) => {
      cell.dataset.first = cell.dataset.first || cell.getAttribute("class");
      const sd = fit.sd ? fit.sd[cell.dataset.w] : null;
      cell.setAttribute("class", !fit.sd ? cell.dataset.first : sd === null ? "usual" : `sd${shade(sd)}`);
      const said = cell.querySelector("title");
      if (!said) return;
      said.dataset.first = said.dataset.first || said.textContent;
      said.textContent = fit.sd ? said.dataset.first.replace(/: [^ ]*/, `: ${sd}`)
        : said.dataset.first;
    });
    if (fit.sd && !fit.shades) fit.shades = fit.sd.map((sd) => sd === null ? null : shade(sd));
    document.dispatchEvent(new CustomEvent("hypothesis", { detail: fit }));
  };

  const switched = (event) => {
    touched = touched || Boolean(event);
    const number = boxes.reduce((sum, box) => sum + (box.checked ? 1 << box.dataset.bit : 0), 0);
    const off = boxes.filter((box) => !box.checked).length;
    choices.forEach((choice, k) => { choice.checked = !off && k === named; });
    const words = `${off} of ${boxes.length} switches off: χ² / degrees of freedom `;
    show(fits[number], off ? `${words}${fits[number].error[0]}.` : touched ? "All switches are on." : "");
    document.body.dataset.fit = String(number);
  };
  const choose = (k) => {
    boxes.forEach((box) => { box.checked = true; });
    const one = hypotheses[k];
    show(one, `Chosen: ${one.words[0].toLowerCase()}${one.words.slice(1)}. χ² / degrees of freedom ${one.error[0]}.`);
    if (fader && (k === 0 || k === named)) fader.value = k === named ? 100 : 0;
    if (fader) fade(false);
  };
  // Between nothing and what was found the model is linear: the residual follows the size, and χ²
  // is a parabola, to first order.
  const fade = (changes) => {
    const share = fader.value / 100;
    const [none, found] = [hypotheses[0], hypotheses[named]];
    const chi2 = found.chi2 + (none.chi2 - found.chi2) * (1 - share) ** 2;
    document.getElementById("faded").textContent =
      `${fader.value} %, χ² ${chi2 < 1e4 ? chi2.toFixed(0) : chi2.toExponential(2)}`;
    const dot = document.getElementById("fader-dot");
    dot.setAttribute("cx", dot.dataset.x0 * 1 + share * dot.dataset.x1);
    dot.setAttribute("cy", dot.dataset.y0 - (1 - share) ** 2 * dot.dataset.y1);
    if (!changes) return;
    choices.forEach((choice, k) => { choice.checked = (k === 0 && share === 0) ||
      (k === named && share === 1); });
    const between = (a, b) => a.map((v, k) => share * v + (1 - share) * b[k]);
    const mixed = (a, b) => a.map((v, k) => between(v, b[k]));
    const error = share === 1 ? [...found.error] : [`${chi2.toPrecision(3)} / ${found.error[0].split(" / ")[1]}`];
    const known = found.known && none.known && mixed(found.known, none.known);
    const size = (rows) => Math.sqrt(rows.flat().reduce((sum, v) => sum + v * v, 0));
    if (found.error[3] && known && share !== 1 && size(found.known) > 0) {
      error[3] = (found.error[3] * size(known) / size(found.known)).toPrecision(3);
    }
    show({ ...found, error, known,
      residuals: between(found.residuals, none.residuals),
      places: share !== 1 && none.places && none.places.map((v) => v.map((x) => (1 - share) * x)) },
      `${fader.value} % of what was found, to first order.`);
  };
  // What the first screen lists can be chosen there.
  const listed = [...document.querySelectorAll("[data-choose]")].map((item) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "choice";
    button.append(...item.childNodes);
    item.append(button);
    button.addEventListener("click", () => choices[item.dataset.choose].click());
    return [button, choices[item.dataset.choose]];
  });
  document.addEventListener("hypothesis", () => listed.forEach(([button, choice]) =>
    button.setAttribute("aria-pressed", choice.checked)));
  boxes.forEach((box) => box.addEventListener("change", switched));
  choices.forEach((choice, k) => choice.addEventListener("change", () => {
    touched = true;
    choose(k);
  }));
  if (fader) fader.addEventListener("input", () => fade(true));
  boxes.forEach((box) => { box.checked = true; });
  if (boxes.length) switched();
  else if (choices.length) choose(named);
})();
