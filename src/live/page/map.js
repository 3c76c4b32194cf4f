// The map of a simulated world: the robot and its path, its collisions, and everything that moves.

import { clock, h, say, visible } from "./dom.js";
import { t } from "./texts.js";

const MARGIN = 0.25;
const LONGEST_WAY = 4000;

export function map(connection, command) {
  const canvas = h("canvas", { class: "map", role: "img" });
  const time = h("span", { class: "quiet" });
  const ink = canvas.getContext("2d");
  let world = null;
  let now = null;
  let way = [];
  let dragged = null;
  let colours = {};
  let scale = 1;

  function palette() {
    // Resolved through the canvas's own colour, which gives the value of the active colour scheme.
    const colour = (name) => {
      canvas.style.color = `var(--${name})`;
      return getComputedStyle(canvas).color;
    };
    colours = Object.fromEntries(["floor", "wall", "ink", "quiet", "accent", "danger", "beacon", "grid", "card"].map((name) => [name, colour(name)]));
  }

  /** Conversion from metres to the canvas and back; y points upwards in the world. */
  const x = (metres) => (metres + MARGIN) * scale;
  const y = (metres) => (world.depth - metres + MARGIN) * scale;
  const metres = (event) => {
    const { left, top, width } = canvas.getBoundingClientRect();
    const ratio = canvas.width / width;
    return [(event.clientX - left) * ratio / scale - MARGIN, world.depth + MARGIN - (event.clientY - top) * ratio / scale];
  };

  function resize() {
    if (!world) {
      return;
    }
    const density = window.devicePixelRatio || 1;
    const width = Math.max(200, canvas.clientWidth);
    scale = width * density / (world.width + 2 * MARGIN);
    canvas.width = Math.round(width * density);
    canvas.height = Math.round((world.depth + 2 * MARGIN) * scale);
  }

  function shape(points, fill, line) {
    ink.beginPath();
    points.forEach(([px, py]) => ink.lineTo(x(px), y(py)));
    ink.closePath();
    paint(fill, line);
  }

  function round([px, py], radius, fill, line) {
    ink.beginPath();
    ink.arc(x(px), y(py), Math.max(1, radius * scale), 0, 2 * Math.PI);
    paint(fill, line);
  }

  function paint(fill, line) {
    if (fill) {
      ink.fillStyle = fill;
      ink.fill();
    }
    if (line) {
      ink.strokeStyle = line;
      ink.stroke();
    }
  }

  function label(text, px, py) {
    ink.fillStyle = colours.ink;
    ink.fillText(visible(text), x(px), y(py));
  }

  function tape({ through, width, closed, rounding, colour }) {
    ink.beginPath();
    ink.lineWidth = Math.max(2, width * scale);
    ink.lineJoin = "round";
    const points = closed ? [...through, through[0], through[1]] : through;
    if (closed) {
      const [a, b] = [through[0], through[1]];
      ink.moveTo(x((a[0] + b[0]) / 2), y((a[1] + b[1]) / 2));
      points.slice(1).forEach((corner, index) => {
        const next = points[index + 2] ?? points[1];
        ink.arcTo(x(corner[0]), y(corner[1]), x(next[0]), y(next[1]), rounding * scale);
      });
    } else {
      ink.moveTo(x(points[0][0]), y(points[0][1]));
      points.slice(1).forEach((corner, index) => {
        const next = points[index + 2];
        if (next && rounding > 0) {
          ink.arcTo(x(corner[0]), y(corner[1]), x(next[0]), y(next[1]), rounding * scale);
        } else {
          ink.lineTo(x(corner[0]), y(corner[1]));
        }
      });
    }
    ink.strokeStyle = colour;
    ink.stroke();
    ink.lineWidth = 1;
  }

  function ground() {
    shape([[0, 0], [world.width, 0], [world.width, world.depth], [0, world.depth]], colours.floor, colours.wall);
    for (const rug of world.rugs) {
      ink.globalAlpha = 0.35;
      shape(rug.corners, rug.colour);
      ink.globalAlpha = 1;
    }
    ink.strokeStyle = colours.grid;
    ink.beginPath();
    for (let metre = 1; metre < world.width; metre += 1) {
      ink.moveTo(x(metre), y(0));
      ink.lineTo(x(metre), y(world.depth));
    }
    for (let metre = 1; metre < world.depth; metre += 1) {
      ink.moveTo(x(0), y(metre));
      ink.lineTo(x(world.width), y(metre));
    }
    ink.stroke();
    shape(world.beacon, colours.beacon);
    world.lines.forEach(tape);
  }

  function objects() {
    for (const item of world.furniture) {
      ink.globalAlpha = 0.85;
      shape(item.corners, item.colour, colours.quiet);
      ink.globalAlpha = 1;
    }
    world.walls.forEach((wall) => shape(wall, colours.wall));
    world.posts.forEach((post) => round(post.at, post.radius, post.colour, colours.ink));
    world.lamps.forEach((lamp) => round(lamp.at, 0.06, "#f5c542", colours.ink));
    world.signs.forEach((sign) => round(sign.at, 0.05, colours.ink, colours.ink));
    shape(world.station, colours.danger, colours.ink);
    ink.textAlign = "center";
    ink.textBaseline = "middle";
    ink.font = `${Math.max(10, 0.13 * scale)}px system-ui, sans-serif`;
    for (const item of world.furniture) {
      const middle = item.corners.reduce(([a, b], [c, d]) => [a + c / 4, b + d / 4], [0, 0]);
      const long = Math.max(...item.corners.map(([a, b]) => Math.hypot(a - middle[0], b - middle[1]))) * 2;
      if (ink.measureText(item.name).width < long * scale * 1.2) {
        ink.lineWidth = 3;
        ink.strokeStyle = colours.card;
        ink.strokeText(item.name, x(middle[0]), y(middle[1]));
        ink.lineWidth = 1;
        label(item.name, ...middle);
      }
    }
  }

  function movingObjects() {
    ink.lineWidth = Math.max(1.5, 0.02 * scale);
    ink.strokeStyle = colours.accent;
    ink.globalAlpha = 0.55;
    ink.beginPath();
    let last = null;
    for (const place of way) {
      const leap = last && Math.hypot(place[0] - last[0], place[1] - last[1]) > 0.5;
      if (!last || leap) {
        ink.moveTo(x(place[0]), y(place[1]));
      } else {
        ink.lineTo(x(place[0]), y(place[1]));
      }
      last = place;
    }
    ink.stroke();
    ink.globalAlpha = 1;
    ink.strokeStyle = colours.danger;
    const arm = 0.06;
    for (const [px, py] of now.bumps) {
      ink.beginPath();
      ink.moveTo(x(px - arm), y(py - arm));
      ink.lineTo(x(px + arm), y(py + arm));
      ink.moveTo(x(px - arm), y(py + arm));
      ink.lineTo(x(px + arm), y(py - arm));
      ink.stroke();
    }
    ink.lineWidth = 1;
    now.balls.forEach((at, index) => world.balls[index] && round(at, world.balls[index].radius, world.balls[index].colour, colours.ink));
    now.walkers.forEach((at, index) => {
      const one = world.walkers[index];
      if (one) {
        round(at, one.radius, one.colour, colours.ink);
        label(one.name, at[0], at[1] + one.radius + 0.12);
      }
    });
  }

  function robot([px, py, heading]) {
    ink.save();
    ink.translate(x(px), y(py));
    ink.rotate(-heading);
    const size = world.radius * scale;
    ink.fillStyle = colours.ink;
    ink.fillRect(-size, -size, size * 2, size * 0.45);
    ink.fillRect(-size, size * 0.55, size * 2, size * 0.45);
    ink.beginPath();
    ink.ellipse(0, 0, size * 0.95, size * 0.62, 0, 0, 2 * Math.PI);
    paint(now.blocked ? colours.danger : colours.accent, colours.card);
    ink.beginPath();
    ink.moveTo(size * 0.8, 0);
    ink.lineTo(size * 0.3, -size * 0.3);
    ink.lineTo(size * 0.3, size * 0.3);
    ink.closePath();
    paint(colours.card);
    ink.restore();
  }

  function draw() {
    if (!world || !now) {
      return;
    }
    ink.clearRect(0, 0, canvas.width, canvas.height);
    ground();
    objects();
    movingObjects();
    robot(dragged?.robot ? [...dragged.at, now.robot[2]] : now.robot);
    if (dragged && !dragged.robot) {
      round(dragged.at, world.balls[dragged.ball].radius, world.balls[dragged.ball].colour, colours.accent);
    }
  }

  connection.on("world", (message) => {
    world = message;
    way = message.way;
    palette();
    resize();
  });
  connection.on("map", (message) => {
    now = message;
    const here = message.robot.slice(0, 2);
    const last = way.at(-1);
    if (!last || Math.hypot(here[0] - last[0], here[1] - last[1]) > 0.02) {
      way.push(here);
      if (way.length > LONGEST_WAY) {
        way = way.filter((_, index) => index % 2 === 1);
      }
    }
    say(time, `${clock(message.time)} · ${message.distance.toFixed(1)} m`);
    const [px, py] = here.map((one) => one.toFixed(1));
    canvas.setAttribute("aria-label", t("map_alt", { name: visible(world?.name ?? ""), x: px, y: py, collisions: message.collisions }));
    draw();
  });
  new ResizeObserver(() => {
    resize();
    draw();
  }).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", palette);
  document.addEventListener("theme", palette);

  canvas.addEventListener("pointerdown", (event) => {
    if (!now || document.body.classList.contains("viewer")) {
      return;
    }
    const at = metres(event);
    const near = ([px, py], radius) => Math.hypot(at[0] - px, at[1] - py) < Math.max(radius, 0.2);
    const ball = now.balls.findIndex((place, index) => near(place, world.balls[index]?.radius ?? 0));
    if (near(now.robot, world.radius)) {
      dragged = { robot: true, at };
    } else if (ball >= 0) {
      dragged = { ball, at };
    } else {
      return;
    }
    canvas.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (dragged) {
      dragged.at = metres(event);
      draw();
    }
  });
  canvas.addEventListener("pointerup", () => {
    if (!dragged) {
      return;
    }
    const [px, py] = dragged.at;
    const change = dragged.robot ? { sim: "place", x: px, y: py } : { sim: "place_ball", number: dragged.ball + 1, x: px, y: py };
    dragged = null;
    command({ do: "sim", change });
  });
  canvas.addEventListener("pointercancel", () => { dragged = null; });

  return h("section", { class: "card map-card", "aria-labelledby": "map-title" },
    h("div", { class: "head" }, h("h2", { id: "map-title" }, t("map")), time),
    canvas,
    h("p", { class: "quiet" }, t("map_hint")));
}
