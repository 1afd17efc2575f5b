// What every figure of a page has: a pose that is pointed at lights up in all of them, and each can
// be saved. Opens what is folded for a printer. Writes text and numbers only, never markup.
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

  const source = document.getElementById("poses-data");
  const told = document.getElementById("pose-words");
  const poses = source ? JSON.parse(source.textContent).poses : [];
  let lit = null;
  const light = (p) => {
    if (p === lit) return;
    if (lit !== null) each(`[data-p="${lit}"]`, (dot) => dot.classList.remove("lit"));
    lit = p;
    if (p !== null) each(`[data-p="${p}"]`, (dot) => dot.classList.add("lit"));
    document.dispatchEvent(new CustomEvent("pose", { detail: p === null ? null : +p }));
    if (!told) return;
    told.hidden = p === null;
    told.textContent = p === null ? "" : poses[p] || `pose ${+p + 1}`;
  };
  document.addEventListener("pointerover", (e) => {
    const dot = e.target.closest ? e.target.closest("[data-p]") : null;
    light(dot ? dot.dataset.p : null);
  });

  const give = (blob, name) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };
  const drawn = (figure) => {
    const shown = [...figure.querySelectorAll("svg")].find((s) => s.getClientRects().length);
    const copy = shown.cloneNode(true);
    const style = document.createElementNS("http://www.w3.org/2000/svg", "style");
    style.textContent = document.querySelector("style").textContent;
    copy.prepend(style);
    const { width, height } = shown.viewBox.baseVal;
    copy.setAttribute("width", width);
    copy.setAttribute("height", height);
    return { text: new XMLSerializer().serializeToString(copy), width, height };
  };
  const save = (figure, kind) => {
    const { text, width, height } = drawn(figure);
    const svg = new Blob([text], { type: "image/svg+xml" });
    if (kind === "SVG") return give(svg, `${figure.id}.svg`);
    const image = new Image();
    image.onload = () => {
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [3 * width, 3 * height];
      canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
      canvas.toBlob((png) => give(png, `${figure.id}.png`));
    };
    image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
    return undefined;
  };
  each("figure[id]", (figure) => {
    const row = document.createElement("div");
    row.className = "save";
    ["SVG", "PNG"].forEach((kind) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = kind;
      button.setAttribute("aria-label", `Save the figure ${figure.id} as ${kind}`);
      button.addEventListener("click", () => save(figure, kind));
      row.append(button);
    });
    figure.append(row);
  });
})();
