// The mechanism in space: turned by a finger, the mouse, keys and buttons; the same drawing as the
// page has without a script. Shows the error of the hypothesis that is chosen.
"use strict";
(() => {
  const source = document.getElementById("mechanism-data");
  if (!source) return;
  const scene = JSON.parse(source.textContent);
  const figure = document.getElementById("mechanism");
  const HEAD = 5;
  const STEP = Math.PI / 36;
  let { azimuth, elevation } = scene;
  let chosen = null;

  const add = (a, b) => a.map((v, k) => v + b[k]);
  const minus = (a, b) => a.map((v, k) => v - b[k]);

  const draw = (svg) => {
    const { scale, x, y } = svg.querySelector(".scene").dataset;
    const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation),
      Math.cos(elevation)];
    const flat = (point) => {
      const [px, py, pz] = minus(point, scene.centre);
      return [+x + scale * (ca * py - sa * px),
        +y - scale * (ce * pz - se * (ca * px + sa * py))];
    };
    const pair = ([u, v]) => `${u.toFixed(1)} ${v.toFixed(1)}`;
    const line = (a, b) => `M${pair(a)}L${pair(b)}`;
    const arrow = (from, to) => {
      const [a, b] = [flat(from), flat(to)];
      const long = Math.hypot(b[0] - a[0], b[1] - a[1]);
      if (long <= HEAD) return line(a, b);
      const [u, v] = [HEAD * (b[0] - a[0]) / long, HEAD * (b[1] - a[1]) / long];
      return `${line(a, b)}M${pair([b[0] - u - v / 2, b[1] - v + u / 2])}L${pair(b)}` +
        `L${pair([b[0] - u + v / 2, b[1] - v - u / 2])}`;
    };
    const path = (kind, text) => {
      const found = svg.querySelector(`path[data-is="${kind}"]`);
      if (found) found.setAttribute("d", text);
    };
    const arrows = (starts, by, stride = 1) => starts.map((from, k) =>
      k % stride ? "" : arrow(from, add(from, by[k]))).join("");
    const bodies = (nodes, edges) =>
      edges.map(([a, b]) => line(flat(nodes[a]), flat(nodes[b]))).join("");
    path("ghosts", scene.ghosts.map((nodes) => bodies(nodes, scene.all)).join(""));
    path("body", bodies(scene.usual, scene.edges));
    path("culprit", bodies(scene.usual, scene.culprits));
    path("before", arrows(scene.places, scene.before, scene.stride));
    path("weak", scene.places.map((at, k) => k % scene.stride ? "" :
      line(flat(add(at, scene.sd[k])), flat(minus(at, scene.sd[k])))).join(""));
    path("chosen", chosen ? arrows(scene.places, chosen.places, scene.stride) : "");
    path("known-before", arrows(scene.known, scene.known_before));
    path("known-after", arrows(scene.known, chosen ? chosen.known : scene.known_after));
    const put = (dots, places) => dots.forEach((dot, k) => {
      const [u, v] = flat(places[k]);
      dot.setAttribute("cx", u.toFixed(1));
      dot.setAttribute("cy", v.toFixed(1));
    });
    put(svg.querySelectorAll("circle[data-p]"), scene.places);
    put(svg.querySelectorAll("circle[data-c]"), scene.known);
    svg.querySelectorAll("[data-n]").forEach((part) => {
      const [u, v] = flat(scene.usual[part.dataset.n]);
      const word = part.tagName === "text", right = u > scene.right * svg.viewBox.baseVal.width;
      part.setAttribute(word ? "x" : "cx", (u + (word ? (right ? -10 : 10) : 0)).toFixed(1));
      part.setAttribute(word ? "y" : "cy", (v + (word ? 4 : 0)).toFixed(1));
      if (word) part.setAttribute("text-anchor", right ? "end" : "start");
    });
  };
  const all = [...figure.querySelectorAll("svg")];
  let asked = false;
  const show = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      all.forEach(draw);
    });
  };
  const turn = (across, up) => {
    azimuth -= across;
    elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, elevation + up));
    show();
  };

  figure.querySelector(".views").hidden = false;
  figure.querySelectorAll(".views [data-azimuth]").forEach((button) => {
    button.addEventListener("click", () => {
      [azimuth, elevation] = [+button.dataset.azimuth, +button.dataset.elevation];
      show();
    });
  });
  all.forEach((svg) => {
    const room = svg.parentElement;
    room.tabIndex = 0;
    room.setAttribute("role", "group");
    room.setAttribute("aria-label", "The mechanism in space: arrow keys turn it");
    room.classList.add("turns");
    let last = null;
    svg.addEventListener("pointerdown", (e) => {
      last = [e.clientX, e.clientY];
      svg.setPointerCapture(e.pointerId);
    });
    svg.addEventListener("pointermove", (e) => {
      if (!last) return;
      turn((e.clientX - last[0]) / 120, (e.clientY - last[1]) / 120);
      last = [e.clientX, e.clientY];
    });
    ["pointerup", "pointercancel"].forEach((name) =>
      svg.addEventListener(name, () => { last = null; }));
    room.addEventListener("keydown", (e) => {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
      if (!by[e.key]) return;
      e.preventDefault();
      turn(STEP * by[e.key][0], STEP * by[e.key][1]);
    });
  });
  document.addEventListener("hypothesis", (e) => {
    if (chosen === e.detail) return;
    chosen = e.detail;
    show();
  });
})();
