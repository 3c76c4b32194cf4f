// The teacher's wall: a tile for each learner, who wants to join, and what concerns all. For a projector: a switch hides
// names and points.

import { h, remember, remembered, s, say } from "/dom.js";
import { logInByLink } from "/login.js";
import { t } from "/texts.js";
import { robot } from "./robot.js";
import { robots } from "./robots.js";
import { script } from "./script.js";
import { connectionBanner, fetchJson, follow, me, post as send } from "./server.js";

const app = document.getElementById("app");

function qrCode(rows) {
  const edge = 4;
  const size = rows.length + 2 * edge;
  const dots = rows.flatMap((row, y) => [...row].map((one, x) => (one === "1" ? `M${x + edge} ${y + edge}h1v1h-1z` : "")));
  return s("svg", { viewBox: `0 0 ${size} ${size}`, class: "qr", role: "img", "aria-label": t("qr") },
    s("rect", { width: size, height: size, fill: "#fff" }), s("path", { d: dots.join(""), fill: "#000" }));
}

async function wall(first) {
  const { lessons, editor: hasEditor, points: full } = await fetchJson("/class/lessons");
  const { rows, link } = await fetchJson("/class/qr");
  let state = first;
  let focused = null;
  const trouble = h("p", { class: "trouble", role: "alert" });
  const post = (what, body) => {
    say(trouble, "");
    return send(what, body, (sentence) => say(trouble, sentence));
  };
  const isHidden = () => hide.getAttribute("aria-pressed") === "true";
  const nameOf = (name) => {
    const number = state.learners.findIndex((one) => one.name === name) + 1;
    return isHidden() && number ? t("learner", { number }) : name;
  };
  const fleet = robots(post, nameOf);
  const { banner, lost } = connectionBanner();
  const toggle = (key, path, more = {}) => {
    const button = h("button", { type: "button", "aria-pressed": "false", onclick: () => post(path, { on: button.getAttribute("aria-pressed") !== "true" }), ...more }, t(key));
    return button;
  };
  const freeze = toggle("freeze", "freeze", { class: "freeze" });
  const showMine = toggle("show_screen", "show");
  const lock = toggle("lock_free", "lock");
  const hide = h("button", {
    type: "button", "aria-pressed": remembered("class-hide", "false"), onclick: () => {
      hide.setAttribute("aria-pressed", String(!isHidden()));
      remember("class-hide", hide.getAttribute("aria-pressed"));
      show(state);
    },
  }, t("hide_names"));
  const forAll = h("select", { id: "for-all", onchange: () => post("lesson", { name: forAll.value || null }) },
    h("option", { value: "" }, t("own_choice")), ...lessons.map(({ name, title }) => h("option", { value: name }, title)));
  const waiting = h("ul", { class: "waiting" });
  const tiles = h("ul", { class: "tiles" });
  const made = new Map();

  // One learner, larger: read only until the teacher helps.
  const title = h("h2", { id: "focus-title" });
  const code = await script({ has: hasEditor, label: t("script"), base: "/class/of" });
  const view = robot((line) => code.editor.showLine(line));
  const help = h("button", { type: "button", "aria-pressed": "false", onclick: () => helping(code.element.inert) }, t("help"));
  const dismiss = h("button", {
    type: "button", onclick: () => confirm(t("dismiss_sure", { name: focused })) && post("dismiss", { name: focused }),
  }, t("dismiss"));
  const close = h("button", { type: "button", onclick: () => focus(null) }, t("close"));
  const dialog = h("dialog", { class: "focus", "aria-labelledby": "focus-title", onclose: () => focus(null) },
    h("div", { class: "head" }, title, h("div", { class: "row" }, help, dismiss, close)),
    h("div", { class: "work" }, h("section", { class: "card" }, code.element, code.status, view.output), view.element));
  function helping(on) {
    code.element.inert = !on;
    view.element.inert = !on;
    help.setAttribute("aria-pressed", String(on));
  }
  function focus(name) {
    if (focused === name) {
      return;
    }
    code.save();
    focused = name;
    helping(false);
    if (name === null) {
      view.show(null);
      return dialog.close();
    }
    say(title, nameOf(name));
    dialog.showModal();
    show(state);
  }

  function showFocus() {
    const learner = state.learners.find(({ name }) => name === focused);
    if (!learner) {
      return;
    }
    const base = `/class/of/${encodeURIComponent(focused)}`;
    const place = learner.run.open && learner.run.place || learner.place || lessons[0].name;
    if (title.dataset.open !== `${base} ${place}`) {
      title.dataset.open = `${base} ${place}`;
      code.open(place, base);
    }
    code.follow(learner.edits);
    view.show(learner.run, base);
  }

  /** A tile, made once and filled again, so that the focus of the keyboard stays. */
  function tile(name) {
    if (!made.has(name)) {
      const [who, what, sentence] = [h("strong", { class: "who" }), h("span", { class: "what" }), h("span", { class: "sentence" })];
      const dots = h("span", { class: "dots" }, ...lessons.map(() => h("span", { class: "dot" })));
      const flags = h("span", { class: "flags" });
      const button = h("button", { type: "button", onclick: () => focus(name) }, who, what, dots, flags, sentence);
      made.set(name, { element: h("li", {}, button), button, who, what, sentence, dots, flags });
    }
    return made.get(name);
  }

  function fill(learner) {
    const one = tile(learner.name);
    const hidden = isHidden();
    const { run, flags, points } = learner;
    say(one.who, nameOf(learner.name));
    const title = lessons.find(({ name }) => name === learner.place)?.title ?? (learner.place ? t("free_play") : "");
    const doing = !learner.present ? t("away") : learner.checking ? t("checking") : run.running ? t("runs") : "";
    say(one.what, [title, doing].filter(Boolean).join(" · "));
    say(one.sentence, hidden ? "" : run.error ?? learner.sentence ?? "");
    say(one.flags, flags.map((flag) => t(`flag_${flag}`)).join(" · "));
    one.button.classList.toggle("away", !learner.present);
    one.button.classList.toggle("runs", run.running);
    one.button.classList.toggle("flagged", flags.length > 0);
    lessons.forEach(({ name }, at) => {
      const dot = one.dots.children[at];
      const has = hidden ? undefined : points[name];
      dot.className = `dot ${has === full ? "full" : has === undefined ? "" : "part"}`;
    });
    one.dots.setAttribute("aria-hidden", "true");
    return one.element;
  }

  function show(now) {
    state = now;
    for (const [button, on] of [[freeze, now.frozen], [showMine, now.shown], [lock, now.locked]]) {
      button.setAttribute("aria-pressed", String(on));
    }
    say(freeze, t(now.frozen ? "unfreeze" : "freeze"));
    forAll.value = now.lesson ?? "";
    fleet.show(now.robots);
    const shown = now.learners.map(fill);
    if (shown.some((one, at) => tiles.children[at] !== one) || tiles.childElementCount !== shown.length) {
      tiles.replaceChildren(...shown);
    }
    const ids = now.waiting.map(({ id }) => id).join();
    if (waiting.dataset.ids !== ids) {
      waiting.dataset.ids = ids;
      const decide = (id, admit) => post("admit", { id, admit });
      waiting.replaceChildren(...now.waiting.map(({ id, name, again, new: fresh }) => h("li", { class: "card row" },
        h("strong", {}, name), h("span", { class: "quiet" }, t(again ? "second_device" : fresh ? "new_name" : "on_list")),
        h("button", { type: "button", class: "primary", "aria-label": t("admit_name", { name }), onclick: () => decide(id, true) }, t("admit")),
        h("button", { type: "button", "aria-label": t("refuse_name", { name }), onclick: () => decide(id, false) }, t("refuse")))));
    }
    if (focused !== null) {
      showFocus();
    }
  }

  helping(false);
  app.replaceChildren(
    h("header", {}, h("div", { class: "top" }, h("h1", {}, t("class_title")),
      h("div", { class: "row acts" }, freeze, showMine, lock, hide, h("span", { class: "field" }, h("label", { for: "for-all" }, t("lesson_for")), forAll),
        h("a", { href: "/class/points.csv" }, t("points_csv")), h("a", { href: "/" }, t("my_workspace")))), banner),
    h("main", { class: "wall" },
      h("section", { class: "card invitation", "aria-label": t("class_join") }, qrCode(rows),
        h("div", {}, h("p", { class: "quiet" }, t("open_link")), h("p", { class: "figure" }, link.replace(/^http:\/\/|\/$/g, "")),
          h("p", { class: "quiet" }, t("word")), h("p", { class: "figure word" }, first.word))),
      fleet.element, h("section", { "aria-label": t("wants_in"), "aria-live": "polite" }, waiting), trouble, tiles),
    dialog);
  show(first);
  return { show, lost };
}

async function begin() {
  await logInByLink();
  const first = await me();
  if (!first?.teacher) {
    return app.replaceChildren(h("main", { class: "login" }, h("div", { class: "card" }, h("h1", {}, t("class_title")), h("p", {}, t("teacher_link")))));
  }
  document.title = t("wall");
  const page = await wall(first);
  follow(page.show, page.lost, () => location.reload());
}

begin();
