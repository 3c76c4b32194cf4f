// History and timetable of a service.

import { FETCH_LIMIT, h, s, say, visible } from "./dom.js";
import { t } from "./texts.js";

/** The ranges of the history in days, with the formats of their axes. */
const RANGES = [
  ["day", 1, { hour: "2-digit", minute: "2-digit", hourCycle: "h23" }],
  ["week", 7, { weekday: "short", day: "numeric" }],
  ["year", 365, { month: "short", year: "numeric" }],
];
/** Least width of what happened within a moment, in parts of the period. */
const MARK = 2.5;
/** Refresh interval of both, in milliseconds. */
export const AGAIN = 60_000;
/** Results of dockings and undockings that are not failures. */
const GOOD = ["done", "already_docked", "not_docked"];

/** Returns what the server answers; null without an answer. */
export async function ask(path) {
  const answer = await fetch(path, { signal: AbortSignal.timeout(FETCH_LIMIT) }).catch(() => null);
  return answer?.ok ? answer.json() : null;
}

/** Returns the text of a code, or the code itself if it has none. */
const word = (prefix, name) => {
  const key = `${prefix}_${name}`;
  const text = t(key);
  return text === key ? name.replaceAll("_", " ") : text;
};

/** A lane of the plot: rectangles `[x, width, top, height]`, in parts of the period and in percent, to the lower edge
 *  unless they have a height; those of `bad` in red. */
function lane(kind, all, bad = []) {
  const path = (name, shapes) => s("path", {
    class: name, d: shapes.map(([x, width, top, height = 100 - top]) => `M${x} ${top}h${width}v${height}h${-width}z`).join(""),
  });
  return s("svg", { class: `plot ${kind}`, viewBox: "0 0 288 100", preserveAspectRatio: "none", "aria-hidden": "true" },
    s("path", { class: "rule", d: `M72 0v100M144 0v100M216 0v100${kind === "level" ? "M0 50h288" : ""}` }),
    path("bar", all), path("bar bad", bad));
}

/** The lanes of a period, each with its name and what it adds up to. */
function lanes({ since, part, parts }) {
  const x = ({ at }) => (at - since) / part;
  const sum = (count) => parts.reduce((total, one) => total + count(one), 0);
  const share = (key) => parts.filter((one) => one[key] > 0).map((one) => [x(one), 1, 100 - Math.max(20, 100 * one[key])]);
  const marks = (key, top) => parts.filter((one) => one[key] > 0).map((one) => [x(one), MARK, top]);
  const hours = (key) => t("hours", { hours: (sum((one) => one[key]) * part / 3.6e6).toFixed(1) });
  const known = parts.filter(({ low }) => low !== null);
  const level = known.map((one, index) => {
    // Joined to the part before it, if that is known.
    const near = index > 0 && one.at - known[index - 1].at === part ? known[index - 1] : one;
    const [low, high] = [Math.min(one.low, near.high), Math.max(one.high, near.low)];
    return [x(one), 1, 100 - high, Math.max(2, high - low)];
  });
  const range = known.length === 0 ? "–"
    : `${Math.min(...known.map(({ low }) => low))}–${Math.max(...known.map(({ high }) => high))} %`;
  const failed = sum(({ failed_docks: count }) => count);
  const docks = sum(({ docks: count }) => count) + failed;
  return [
    ["battery", range, lane("level", level)],
    ["lane_charging", hours("charging"), lane("charging", share("charging"))],
    ["lane_runs", `${sum(({ runs }) => runs)} · ${hours("running")}`, lane("runs", share("running"))],
    ["lane_docks", failed ? t("docks_failed", { docks, failed }) : docks, lane("docks", marks("docks", 45), marks("failed_docks", 0))],
    ["lane_alarms", sum(({ alarms }) => alarms), lane("alarms", [], marks("alarms", 0))],
  ];
}

function row({ at, kind, behaviour, code, text }) {
  const what = [word("event", kind), behaviour, code ? word("code", code) : ""].filter((one) => one).join(" · ");
  const bad = kind === "given_up" || kind === "notify" || kind === "safety" || (kind === "dock" && !GOOD.includes(code));
  return h("li", { class: bad && "bad" },
    h("time", {}, time.format(new Date(at))), h("span", { class: "text" }, text ? `${what}: ${text}` : what));
}

const language = document.documentElement.lang;
const time = new Intl.DateTimeFormat(language, { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit", hourCycle: "h23" });

export function historyCard(connection) {
  const drawing = h("div", { class: "lanes", role: "img" });
  const axis = h("span", { class: "quiet scale" });
  const events = h("ol", { class: "events", tabindex: 0, "aria-label": t("history") });
  const buttons = RANGES.map((range) => h("button", { type: "button", onclick: () => choose(range) }, t(`range_${range[0]}`)));
  let chosen = RANGES[0];
  let timer = null;

  function choose(range) {
    chosen = range;
    buttons.forEach((button, index) => button.setAttribute("aria-pressed", String(RANGES[index] === range)));
    show();
  }

  function draw(told, [name, , format]) {
    const all = lanes(told);
    drawing.replaceChildren(...all.flatMap(([key, total, plot]) => [
      h("span", { class: "quiet" }, t(key)), plot, h("span", { class: "quiet total" }, total)]), axis);
    const words = all.map(([key, total]) => `${t(key)} ${total}`).join("; ");
    drawing.setAttribute("aria-label", visible(`${t(`range_${name}`)}: ${words}`));
    const label = new Intl.DateTimeFormat(language, format);
    const moments = [told.since, (told.since + told.until) / 2, told.until];
    axis.replaceChildren(...moments.map((at) => h("span", {}, label.format(new Date(at)))));
  }

  async function show() {
    clearTimeout(timer);
    timer = setTimeout(show, AGAIN * Math.min(10, chosen[1]));
    const range = chosen;
    const told = document.hidden && !card.hidden ? null : await ask(`/api/history?days=${range[1]}`);
    if (!told || range !== chosen) {
      return;
    }
    card.hidden = false;
    draw(told, range);
    events.replaceChildren(...told.events.toReversed().map(row));
  }

  const card = h("section", { class: "card history", "aria-labelledby": "history-title", hidden: true },
    h("div", { class: "head" }, h("h2", { id: "history-title" }, t("history")),
      h("div", { class: "row ranges", role: "group", "aria-label": t("history_of") }, ...buttons)),
    drawing, events);
  connection.on("hello", () => choose(chosen));
  return card;
}

/** Shortens an end such as `Sun 2026-03-29 01:30` to the time if it is on the day of the start. */
const ending = (at, until) => (until.slice(0, -5) === at.slice(0, -5) ? until.slice(-5) : until);

export function schedule(connection, command) {
  const list = h("ol", { class: "starts" });
  const paused = h("p", { role: "status" });
  const change = (fields) => command({ do: "timetable", ...fields });
  const skip = h("button", { type: "button", onclick: () => change(next.skipped ? { change: "unskip" } : { change: "skip", start: next.at }) });
  const until = h("input", { type: "datetime-local", "aria-label": t("pause_until") });
  const pause = h("button", { type: "button", onclick: () => until.value && change({ change: "pause", until: new Date(until.value).toISOString() }) }, t("pause_until"));
  const resume = h("button", { type: "button", onclick: () => change({ change: "resume" }) }, t("resume"));
  const hand = h("div", { class: "row driver-only" }, skip, resume, pause, until);
  let next = null;
  let told = "";
  let timer = null;

  function update(state) {
    const news = JSON.stringify([state.next, state.paused]);
    if (news === told) {
      return;
    }
    told = news;
    next = state.next;
    skip.hidden = next === null;
    say(skip, t(next?.skipped ? "keep_start" : "leave_out"));
    resume.hidden = state.paused === null;
    say(paused, state.paused === null ? "" : t("paused_until", { time: time.format(new Date(state.paused)) }));
    show();
  }

  async function show() {
    clearTimeout(timer);
    timer = setTimeout(show, AGAIN);
    const starts = document.hidden && !card.hidden ? null : await ask("/api/schedule");
    if (!starts) {
      return;
    }
    card.hidden = false;
    list.replaceChildren(...starts.map(({ at, run, until, notes }) => h("li", {},
      h("time", {}, at), h("strong", {}, run),
      h("span", { class: "quiet" }, [until ? t("until", { time: ending(at, until) }) : "", ...notes.map((note) => t(`start_${note}`))].filter((one) => one).join(" · ")))));
  }

  const card = h("section", { class: "card schedule", "aria-labelledby": "schedule-title", hidden: true },
    h("h2", { id: "schedule-title" }, t("schedule")), paused, list, hand);
  connection.on("hello", show);
  connection.on("state", update);
  return card;
}
