// The page: login, layout, and the STOP button, which is always visible.

import { age, battery } from "./battery.js";
import { behaviours } from "./behaviours.js";
import { camera } from "./camera.js";
import { Connection } from "./connection.js";
import { clock, h, remember, remembered, say, visible } from "./dom.js";
import { drive } from "./drive.js";
import { gallery } from "./gallery.js";
import { log } from "./log.js";
import { askForToken, logInByLink, logOut, me } from "./login.js";
import { map } from "./map.js";
import { historyCard, schedule } from "./history.js";
import { closePhoto } from "./photo.js";
import { robot } from "./robot.js";
import { closeScript } from "./script.js";
import { simulation } from "./simulation.js";
import { emergencyStop } from "./stop.js";
import { language, languages, t } from "./texts.js";

const NOTICE = 6000;

function theme() {
  const chosen = remembered("theme", "auto");
  document.documentElement.dataset.theme = chosen;
  document.dispatchEvent(new Event("theme"));
}

function choice(id, key, options, value, changed) {
  const select = h("select", { id, onchange: () => changed(select.value) },
    ...options.map(([name, text]) => h("option", { value: name, selected: name === value }, text)));
  return h("span", { class: "field" }, h("label", { for: id }, t(key)), select);
}

function build(app, visitor) {
  const connection = new Connection();
  const title = h("h1", {}, "spykee");
  const state = h("p", { class: "state", role: "status" }, t("connecting"));
  const [level, active, more] = [h("span", { class: "level" }), h("span"), h("span", { class: "more" })];
  const detail = h("p", { class: "quiet detail" }, level, active, more);
  const banner = h("p", { class: "banner", role: "alert", hidden: true });
  const notice = h("p", { class: "notice", role: "status" });
  let fading = null;
  let last = null;
  let you = null;

  function note(text) {
    say(notice, text);
    notice.classList.toggle("on", text !== "");
    clearTimeout(fading);
    fading = setTimeout(() => notice.classList.remove("on"), NOTICE);
  }

  async function command(what) {
    const answer = await connection.command(what);
    if (!answer.ok) {
      note(t("failed", { text: answer.text }));
    }
    return answer;
  }

  const stop = emergencyStop(connection, show);
  // In the capture phase, before any other listener and wherever the focus is.
  window.addEventListener("keydown", (event) => event.key === "Escape" && (closeScript() || closePhoto() || stop.engage()), true);

  const name = h("input", {
    id: "name", maxlength: 24, autocomplete: "nickname", value: remembered("name", ""),
    onchange: () => {
      remember("name", name.value);
      connection.send({ type: "name", name: name.value });
    },
  });

  const parts = {
    camera: camera(connection), drive: drive(connection, command, note), map: map(connection, command),
    battery: battery(connection), robot: robot(connection, command), behaviours: behaviours(connection, command),
    simulation: simulation(connection, command), log: log(connection), history: historyCard(connection), schedule: schedule(connection, command),
    gallery: gallery(connection),
  };
  /** Past all lines of the log. */
  function skip(event) {
    event.preventDefault();
    parts.drive.querySelector(".drive-lock").focus();
  }

  const controls = h("fieldset", { class: "grid", role: "none" },
    h("div", { class: "column" }, parts.camera, parts.gallery, parts.log, parts.history),
    h("div", { class: "column" }, parts.map, parts.behaviours, parts.schedule, parts.simulation),
    h("div", { class: "column" }, parts.drive, parts.battery, parts.robot));
  app.replaceChildren(
    h("header", {},
      h("a", { class: "skip driver-only", href: "#drive-title", onclick: skip }, t("skip")),
      h("div", { class: "top" },
        h("img", { src: "/icon.svg", alt: "", width: 36, height: 36 }),
        h("div", { class: "who" }, title, detail),
        h("div", { class: "how" }, state),
        stop.element),
      banner),
    h("main", {}, controls),
    notice,
    h("footer", { class: "row" },
      h("span", { class: "field" }, h("label", { for: "name" }, t("name")), name),
      choice("language", "language", languages, language, (value) => {
        remember("language", value);
        location.reload();
      }),
      choice("theme", "theme", ["auto", "light", "dark"].map((one) => [one, t(`theme_${one}`)]), remembered("theme", "auto"), (value) => {
        remember("theme", value);
        theme();
      }),
      h("a", { href: "/book/", target: "_blank", rel: "noopener" }, t("book")),
      visitor.open ? null : h("button", { type: "button", onclick: logOut }, t("logout"))));

  connection.on("open", () => {
    if (name.value) {
      connection.send({ type: "name", name: name.value });
    }
  });
  connection.on("hello", (hello) => {
    you = hello.you;
    document.body.classList.toggle("viewer", hello.role === "viewer");
    document.body.classList.toggle("real", !hello.world);
    connection.watch({ map: hello.world, log: true });
  });
  connection.on("state", (now) => {
    say(title, now.robot?.name ?? "spykee");
    document.title = `${visible(now.robot?.name ?? "spykee")} · ${typeof now.battery?.percent === "number" ? `${now.battery.percent} %` : ""}`;
    last = now;
    const { percent = null, charging } = now.battery ?? {};
    const old = age(now) || (charging && t("charging"));
    say(level, percent === null ? "" : `${percent} %${old ? `, ${old}` : ""}`);
    level.classList.toggle("low", now.low);
    say(active, now.behaviours.map((one) => one.name).join(", "));
    const facts = [
      now.link === "up" ? t(`dock_state_${now.dock_state}`) : null,
      now.simulated ? t("simulated") : now.target,
      t("running", { time: clock(now.running) }),
      now.viewers > 1 ? t("viewers", { count: now.viewers }) : null,
      visitor.role === "viewer" ? t("role_viewer") : null,
    ];
    say(more, facts.filter((one) => one).join(" · "));
    show();
  });
  connection.on("notice", ({ key, name: other }) => note(t(key, { name: other })));
  connection.on("lost", async () => {
    // Only six requests are sent at once: those of STOP come first.
    if (connection.stopping) {
      return;
    }
    const still = await me().catch(() => null);
    if (still && still.role === null) {
      location.reload();
    }
  });

  connection.on("age", show);

  /** Shows what is wrong, if anything is: header, banner, and whether the controls work. */
  function show() {
    const { late } = connection;
    const stopped = stop.sentence();
    controls.disabled = late || connection.stopping;
    document.body.classList.toggle("lost", late);
    if (late) {
      say(state, t("no_connection", { seconds: Math.floor(connection.age / 1000) }));
      state.className = "state bad";
    } else if (last) {
      say(state, words(last));
      state.className = `state ${last.emergency_stop ? "bad" : kind(last)}`;
    }
    // The seconds are not read out, but the banner is.
    state.setAttribute("aria-live", late ? "off" : "polite");
    const low = stopped && last?.low ? ` ${t("emergency_stop_low")}` : "";
    say(banner, stopped ? `${t(stopped)}${low}` : late ? t(connection.evicted ? "evicted" : "server_lost") : "");
    banner.hidden = banner.textContent === "";
    banner.classList.toggle("loud", ["stop_no_connection", "stop_out_of_reach"].includes(stopped));
  }

  function words(now) {
    if (now.link !== "up") {
      return t(now.link);
    }
    if (now.emergency_stop) {
      return t("stop");
    }
    if (now.driver) {
      return now.driver.id === you ? t("driving_you") : t("driving", { name: now.driver.name });
    }
    return t(now.safety);
  }

  connection.connect();
  stop.resume();
}

function kind(now) {
  if (now.link !== "up" || now.safety === "alarm") {
    return "bad";
  }
  return now.low ? "warn" : "good";
}

async function begin() {
  theme();
  const app = document.getElementById("app");
  // A link with a token, opened where the page is open already.
  window.addEventListener("hashchange", () => location.reload());
  const linked = await logInByLink();
  let visitor = await me().catch(() => null);
  while (visitor === null) {
    app.replaceChildren(h("p", { class: "banner", role: "alert" }, t("server_lost")));
    await new Promise((resolve) => setTimeout(resolve, 1000));
    visitor = await me().catch(() => null);
  }
  if (visitor.role === null) {
    visitor = await askForToken(app, linked.error);
  }
  build(app, visitor);
}

begin();
