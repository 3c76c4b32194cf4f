// A learner's page: joining, then the lesson, the script, the robot and the check.

import { h, remember, remembered, say } from "/dom.js";
import { t } from "/texts.js";
import { markdown } from "./lesson.js";
import { robot } from "./robot.js";
import { script } from "./script.js";
import { ask, connectionBanner, fetchJson, follow, me, post } from "./server.js";
import { turns } from "./turns.js";

const FREE = "free";
const NOTICE = 6000;
/** The lessons that have blocks. */
const WITH_BLOCKS = 6;
const app = document.getElementById("app");

function joinForm() {
  const field = (id, key, more) => [h("label", { for: id }, t(key)), h("input", { id, required: true, autocomplete: "off", ...more })];
  const word = decodeURIComponent(location.hash.slice(1)).replaceAll("-", " ");
  const [wordLabel, wordField] = field("word", "class_word", { autocapitalize: "none", value: word, maxlength: 60 });
  const [nameLabel, nameField] = field("name", "class_name", { maxlength: 24, value: remembered("class-name", "") });
  const trouble = h("p", { class: "trouble", role: "alert" });
  const submit = async (event) => {
    event.preventDefault();
    const answer = await ask("/class/join", { word: wordField.value, name: nameField.value });
    if (!answer.ok) {
      return say(trouble, answer.error || t("server_lost"));
    }
    remember("class-name", nameField.value);
    history.replaceState(null, "", location.pathname);
    begin();
  };
  app.replaceChildren(h("main", { class: "login" }, h("form", { class: "card", onsubmit: submit },
    h("h1", {}, t("class_title")), wordLabel, wordField, nameLabel, nameField,
    h("button", { class: "primary" }, t("class_join")), trouble, h("p", { class: "quiet" }, t("class_privacy")))));
  (word ? nameField : wordField).focus();
}

const waitingPage = (name) => app.replaceChildren(h("main", { class: "login" },
  h("div", { class: "card", role: "status" }, h("h1", {}, name), h("p", {}, t("class_wait")))));

/** The points of a check, and what is missing. */
function showCheck(element, check, checking) {
  if (checking) {
    return element.replaceChildren(h("p", {}, t("checking")));
  }
  if (!check) {
    return element.replaceChildren();
  }
  const rows = check.scenarios.map(({ name, points, max_points: most, message }) => h("li", { class: points === most ? "good" : "bad" },
    h("strong", {}, `${points}/${most}`), ` ${name}`, message && message !== check.sentence ? h("span", { class: "quiet" }, ` ${message}`) : null));
  element.replaceChildren(
    h("p", { class: check.passed ? "good" : "" }, h("strong", {}, t("points", { points: check.points, of: check.max_points })), ` ${check.sentence}`),
    h("ul", { class: "scenarios" }, ...rows));
}

async function workspace(first) {
  const { lessons, worlds, editor: hasEditor, blocks: hasBlocks, points: full } = await fetchJson("/class/lessons");
  let state = first;
  let blocks = null;
  let given = null;
  let fading = null;
  let failed = null;
  let shownTurns = null;
  const notice = h("p", { class: "notice", role: "status" });
  function note(text) {
    say(notice, text);
    notice.classList.toggle("on", text !== "");
    clearTimeout(fading);
    fading = setTimeout(() => notice.classList.remove("on"), NOTICE);
  }
  const own = await script({ has: hasEditor, label: t("script_of", { name: state.name }), note });
  const view = robot((line) => own.editor.showLine(line));
  const { banner, lost } = connectionBanner();
  const lessonText = h("div", { class: "text" });
  const result = h("div", { class: "result", role: "status" });
  const failure = h("p", { class: "trouble", role: "alert" });
  const blockArea = h("div", { class: "blocks", hidden: true });

  const select = (id, key, options, changed) => {
    const made = h("select", { id, onchange: changed }, ...options.map(([value, text]) => h("option", { value }, text)));
    return [made, h("span", { class: "field" }, h("label", { for: id }, t(key)), made)];
  };
  const [lesson, lessonField] = select("lesson", "lesson", [...lessons.map(({ name }) => [name, name]), [FREE, t("free_play")]], () => open(lesson.value));
  const [world, worldField] = select("world", "world", worlds.map((name) => [name, name]), () => {});
  const [speed, speedField] = select("speed", "sim_speed", [[1, "1x"], [0.5, "½x"], [0.25, "¼x"]], () => view.speed(Number(speed.value)));
  const order = () => ({ lesson: own.place, speed: Number(speed.value), blocks: blocks !== null, ...(own.place === FREE ? { world: world.value } : {}) });
  async function act(what, body) {
    say(failure, "");
    await own.save();
    await post(what, body, note);
  }
  const button = (key, action, more = {}) => h("button", { type: "button", onclick: action, ...more }, t(key));
  const turn = turns((what, body) => post(what, body, note), () => show(state));
  const run = button("run", () => act(turn.real ? "turn/run" : "run", order()), { class: "primary" });
  const stop = button("stop_script", () => act(turn.real ? "turn/stop" : "stop"), { title: t("stop_script_help") });
  const reset = button("reset", () => act("run", { ...order(), stands: true }));
  const check = button("check", () => act("check", { lesson: own.place }));
  const toBlocks = button("blocks", () => openBlocks(null));
  const toText = button("to_text", closeBlocks, { hidden: true });
  window.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) {
      event.preventDefault();
      run.click();
    }
  }, true);

  const blocksPath = () => `/class/script?lesson=${encodeURIComponent(own.place)}&blocks=true`;
  let stored = { text: "", version: "" };
  async function storeBlocks(text, keep = false) {
    const answer = await ask(blocksPath(), { text, version: stored.version, keep }, { method: "PUT" });
    stored = answer.ok ? { text, version: answer.version } : answer.status === 409 ? answer : stored;
  }
  async function openBlocks(text) {
    if (!text && own.editor.text.trim() && !confirm(t("blocks_sure"))) {
      return;
    }
    const module = await import("/class/blocks.js");
    await own.save();
    let storing = null;
    showBlocks(true);
    blocks = module.blocks(blockArea, {
      state: text ? JSON.parse(text) : null,
      onChange: (now, luau) => {
        own.replace(luau);
        clearTimeout(storing);
        storing = setTimeout(() => storeBlocks(JSON.stringify(now)), 500);
      },
    });
    if (!text) {
      // The text so far stays among the older versions.
      await storeBlocks(JSON.stringify(blocks.state), true);
    }
    own.replace(blocks.luau);
  }
  function closeBlocks() {
    storeBlocks("");
    blocks?.dispose();
    blocks = null;
    showBlocks(false);
    own.editor.focus();
  }
  function showBlocks(on) {
    blockArea.replaceChildren();
    blockArea.hidden = !on;
    toText.hidden = !on;
    main.classList.toggle("with-blocks", on);
    toBlocks.hidden = on || !hasBlocks || !WITH_BLOCKS || lessons.findIndex(({ name }) => name === own.place) >= WITH_BLOCKS;
    own.element.inert = on;
  }
  view.connection.on("log", ({ lines }) => {
    const line = lines.findLast(({ level, text }) => level === "debug" && /^\d+$/.test(text))?.text;
    if (line) {
      blocks?.highlight(Number(line));
    }
  });

  async function open(name) {
    await own.open(name);
    lesson.value = own.place;
    if (own.place !== name) {
      return;
    }
    blocks?.dispose();
    blocks = null;
    remember("class-lesson", name);
    worldField.hidden = name !== FREE;
    check.hidden = name === FREE;
    const found = lessons.find((one) => one.name === name);
    lessonText.replaceChildren(h("h2", {}, found?.title ?? t("free_play")), ...(found ? markdown(found.text) : [h("p", {}, t("free_help"))]));
    stored = hasBlocks ? await fetchJson(blocksPath()) : stored;
    if (stored.text) {
      await openBlocks(stored.text);
    } else {
      showBlocks(false);
    }
    show(state);
  }

  const columns = h("div", { class: "work" },
    h("section", { class: "card task", "aria-label": t("lesson") }, lessonText),
    h("section", { class: "card code-card", "aria-label": t("script") }, blockArea, own.element,
      h("div", { class: "row" }, own.status, toBlocks, toText), failure, result, view.output),
    view.element);
  const acts = h("div", { class: "row acts" }, run, stop, reset, check, speedField);
  const shownName = h("h2", { role: "status" });
  const shownCode = h("div", { class: "work shown", hidden: true });
  const main = h("main", {}, turn.element, shownCode, columns);
  let screen = null;

  /** The teacher's screen, read only. */
  async function showScreen(now) {
    const on = now.shown && !now.teacher;
    if (on && !screen) {
      screen = { code: await script({ base: "/class/of/teacher", has: hasEditor, readOnly: true, label: t("shown") }), view: robot() };
      shownCode.append(h("section", { class: "card code-card" }, shownName, screen.code.element, screen.view.output), screen.view.element);
    }
    shownCode.hidden = !on;
    say(shownName, now.frozen ? `${t("shown")} · ${t("frozen")}` : t("shown"));
    columns.hidden = acts.hidden = run.disabled = on;
    turn.element.hidden = on || !now.turns;
    if (screen && on && now.teacher_place) {
      if (screen.code.place !== now.teacher_place) {
        await screen.code.open(now.teacher_place);
      }
      screen.code.follow(now.teacher_edits);
    }
    screen?.view.show(on ? now.teacher_run : null, "/class/of/teacher");
    document.body.classList.toggle("viewer", on);
  }

  const frozen = h("dialog", { class: "frozen", "aria-labelledby": "frozen-title", oncancel: (event) => event.preventDefault() },
    h("h2", { id: "frozen-title", tabindex: -1 }, t("frozen")), h("p", {}, t("frozen_help")));

  function show(now) {
    const previous = state;
    state = now;
    if (now.turns !== shownTurns) {
      shownTurns = now.turns;
      turn.show(now.turns);
    }
    const { real } = turn;
    const error = real ? real.error : now.run.place === own.place ? now.run.error : null;
    if (error !== failed || now.run.number !== previous.run.number) {
      failed = error;
      own.fail(error);
    }
    say(failure, error ?? "");
    own.follow(now.edits);
    if (real) {
      view.show({ open: true, number: real.number }, "/class/turn");
    } else {
      view.show(now.run);
    }
    stop.disabled = !(real ? real.runs : now.run.running);
    if (stop.disabled) {
      blocks?.highlight(null);
    }
    reset.disabled = speed.disabled = real !== null;
    check.disabled = now.checking;
    showCheck(result, now.check?.lesson === own.place ? now.check : null, now.checking);
    for (const option of lesson.options) {
      const points = now.points[option.value];
      const title = lessons.find(({ name }) => name === option.value)?.title ?? t("free_play");
      say(option, `${title}${points === undefined ? "" : points === full ? " ✓" : ` (${points}/${full})`}`);
    }
    if (now.lesson !== given && now.lesson) {
      open(now.lesson);
      note(t("lesson_for_all"));
    }
    given = now.lesson;
    const stands = now.frozen && !now.teacher && !now.shown;
    if (stands && !frozen.open) {
      frozen.showModal();
    } else if (!stands && frozen.open) {
      frozen.close();
    }
    showScreen(now);
  }

  app.replaceChildren(
    h("header", {}, h("div", { class: "top" },
      h("h1", {}, state.teacher ? t("teachers_workspace") : state.name), lessonField, worldField, acts,
      state.teacher ? h("a", { href: "/wall" }, t("wall")) : null), banner),
    main, frozen, notice);
  given = state.lesson;
  const known = [...lessons.map(({ name }) => name), FREE];
  const last = [state.lesson, state.place, remembered("class-lesson", "")].find((name) => known.includes(name));
  await open(last ?? known[0]);
  return { show, lost };
}

async function begin() {
  const now = await me().catch(() => undefined);
  if (now === undefined) {
    return setTimeout(begin, 1000);
  }
  if (now === null) {
    return joinForm();
  }
  let page = null;
  let making = false;
  const show = async (state) => {
    document.title = `${state.name} · spykee`;
    if (!state.admitted) {
      return waitingPage(state.name);
    }
    if (!page && !making) {
      making = true;
      page = await workspace(state);
    }
    page?.show(state);
  };
  follow(show, (is) => page?.lost(is), () => location.reload());
}

begin();
