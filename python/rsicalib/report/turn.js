// The mechanism in the room: turned by a finger, the mouse, keys and buttons; the same drawing as the
// page has without a script. Shows the error of the hypothesis that is chosen, and the pose that is
// pointed at.
"use strict";
(() => {
  const source = document.getElementById("mechanism-data");
  if (!source) return;
  const scene = JSON.parse(source.textContent);
  const figure = document.getElementById("mechanism");
  const [HEAD, BOLD, LINE, STEP] = [5, 7.6, 14, Math.PI / 36];
  const first = { azimuth: scene.azimuth, elevation: scene.elevation };
  let { azimuth, elevation } = first;
  let [chosen, lit] = [null, null];

  const add = (a, b) => a.map((v, k) => v + b[k]);
  const minus = (a, b) => a.map((v, k) => v - b[k]);
  const pair = ([u, v]) => `${u.toFixed(1)} ${v.toFixed(1)}`;
  const line = (a, b) => `M${pair(a)}L${pair(b)}`;
  const closed = (points) => `M${points.map(pair).join("L")}Z`;

  // Points as pixels, and pixels of a unit of length: nothing leaves the canvas, however it is turned.
  const projection = (svg) => {
    const { x, y } = svg.querySelector(".scene").dataset;
    const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation),
      Math.cos(elevation)];
    const up = scene.tall * Math.abs(ce) + scene.radius * Math.abs(se) || 1e-9;
    const scale = Math.min((x - scene.margin) / scene.radius, (y - scene.margin) / up);
    const flat = (point) => {
      const [px, py, pz] = minus(point, scene.centre);
      return [+x + scale * (ca * py - sa * px), +y - scale * (ce * pz - se * (ca * px + sa * py))];
    };
    return { flat, scale };
  };

  const draw = (svg) => {
    const { flat, scale } = projection(svg);
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
    const body = scene.ghosts[lit] || scene.usual;
    path("floor", scene.floor.map(([a, b]) => line(flat(a), flat(b))).join(""));
    path("ghosts", scene.ghosts.map((nodes) => bodies(nodes, scene.all)).join(""));
    path("halo", bodies(body, scene.all));
    path("plate", closed(scene.plate.map((k) => flat(body[k]))));
    path("body", bodies(body, scene.edges));
    path("culprit", bodies(body, scene.culprits));
    path("before", arrows(scene.places, scene.before, scene.stride));
    path("weak", scene.places.map((at, k) => k % scene.stride ? "" :
      line(flat(add(at, scene.sd[k])), flat(minus(at, scene.sd[k])))).join(""));
    path("chosen", chosen && chosen.places ? arrows(scene.places, chosen.places, scene.stride) : "");
    path("known-before", arrows(scene.known, scene.known_before));
    // Of a law that no term has it is not known what it does there.
    const after = (chosen && chosen.known) || scene.known_after;
    path("known-after", after.length ? arrows(scene.known, after) : "");
    const put = (dots, places) => dots.forEach((dot, k) => {
      const [u, v] = flat(places[k]);
      dot.setAttribute("cx", u.toFixed(1));
      dot.setAttribute("cy", v.toFixed(1));
    });
    put(svg.querySelectorAll("circle[data-p]"), scene.places);
    put(svg.querySelectorAll("circle[data-c]"), scene.known);
    put(svg.querySelectorAll("circle[data-n]"), [...svg.querySelectorAll("circle[data-n]")]
      .map((dot) => body[dot.dataset.n]));
    names(svg, body, flat);
    svg.querySelectorAll("[data-axis]").forEach((word) => {
      const [u, v] = flat(scene.axes[word.dataset.axis]);
      word.setAttribute("x", u.toFixed(1));
      word.setAttribute("y", (v + 4).toFixed(1));
    });
    svg.querySelectorAll("[data-bar]").forEach((bar) => {
      const { x, y } = bar.dataset;
      bar.setAttribute("d", `M${x} ${y - 3}v6m0 -3h${(scale * bar.dataset.bar).toFixed(1)}m0 -3v6`);
    });
    if (scene.cells) cells(svg, flat);
  };

  // Names stand on the outer side of what they name, or above it on the inner side; below names
  // that are there.
  const names = (svg, body, flat) => {
    const taken = [], { width } = svg.viewBox.baseVal;
    svg.querySelectorAll("text[data-n]").forEach((word) => {
      const [x, at] = flat(body[word.dataset.n]);
      const long = BOLD * word.textContent.length;
      const fits = x > width / 2 ? x + 10 + long < width : x - 10 - long >= 0;
      const right = fits === x > width / 2;
      const low = right ? x + 10 : x - 10 - long;
      let y = at + 4 - (fits ? 0 : LINE);
      taken.sort((a, b) => a[2] - b[2]).forEach(([start, end, other]) => {
        if (low < end && start < low + long && Math.abs(y - other) < LINE) y = other + LINE;
      });
      taken.push([low, low + long, y]);
      word.setAttribute("x", (right ? low : low + long).toFixed(1));
      word.setAttribute("y", y.toFixed(1));
      word.setAttribute("text-anchor", right ? "start" : "end");
    });
  };

  const cells = (svg, flat) => {
    const { at, half: [a, b], z } = scene.cells;
    const { shades, first } = scene.cells;
    const shade = (k) => chosen && chosen.shades ? chosen.shades[first + k] : shades[k];
    const paths = new Map();
    at.forEach(([x, y], k) => {
      if (shade(k) === null) return;
      const corners = [[x - a, y - b, z], [x + a, y - b, z], [x + a, y + b, z], [x - a, y + b, z]];
      paths.set(shade(k), (paths.get(shade(k)) || "") + closed(corners.map(flat)));
    });
    svg.querySelector(".cells").replaceChildren(...[...paths].map(([shade, where]) => {
      const part = document.createElementNS("http://www.w3.org/2000/svg", "path");
      part.setAttribute("class", `sd${shade}`);
      part.setAttribute("d", where);
      return part;
    }));
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
  figure.querySelectorAll(".views [data-layer]").forEach((button) => {
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", on);
      figure.querySelectorAll(`.${button.dataset.layer}`).forEach((layer) => {
        if (on) layer.removeAttribute("display");
        else layer.setAttribute("display", "none");
      });
    });
  });
  // On a page of its own it turns by itself, until it is held: nobody has to look at what moves.
  if (figure.dataset.moving !== undefined) {
    const button = document.createElement("button");
    let [before, moving] = [null, false];
    const step = (now) => {
      if (!moving) return;
      azimuth += before === null ? 0 : 2.5e-4 * Math.min(now - before, 100);
      before = now;
      all.forEach(draw);
      requestAnimationFrame(step);
    };
    const move = (on) => {
      [before, moving] = [null, on];
      button.textContent = on ? "hold still" : "turn";
      if (on) requestAnimationFrame(step);
    };
    button.type = "button";
    button.className = "moves";
    button.addEventListener("click", () => move(!moving));
    figure.querySelector(".views").prepend(button);
    ["pointerdown", "keydown"].forEach((name) => figure.addEventListener(name, (e) => {
      if (e.target !== button) move(false);
    }));
    move(!window.matchMedia("(prefers-reduced-motion: reduce)").matches);
  }
  all.forEach((svg) => {
    const room = svg.parentElement;
    room.tabIndex = 0;
    room.setAttribute("role", "group");
    room.setAttribute("aria-label", "The mechanism in the room: arrow keys turn it, Home turns it back");
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
      if (e.key === "Home") ({ azimuth, elevation } = first);
      else if (!by[e.key]) return;
      e.preventDefault();
      const [across, up] = by[e.key] || [0, 0];
      turn(STEP * across, STEP * up);
    });
  });
  document.addEventListener("hypothesis", (e) => {
    // What was found is what is drawn already.
    const other = e.detail.places || e.detail.shades ? e.detail : null;
    if (chosen === other) return;
    chosen = other;
    show();
  });
  document.addEventListener("pose", (e) => {
    const at = scene.poses.indexOf(e.detail);
    if (lit === (at < 0 ? null : at)) return;
    lit = at < 0 ? null : at;
    show();
  });
})();
