// STOP: said over the WebSocket and by requests of its own, again and again, until it is confirmed or the person gives
// up; over a lost connection and a reload too.

import { h, say, since, stamp } from "./dom.js";
import { t } from "./texts.js";

const AGAIN = 1000;
/** A request may hang: until then, others are sent beside it. After this time without an answer STOP counts as not
 *  delivered. */
const TIMEOUT = 3000;
const MOST = 3;
/** After this time a person may give up; milliseconds. */
const PATIENCE = 2000;
const KEY = "spykee.stop";

/** Stores that a STOP is not confirmed, for this tab. */
function keep(is) {
  try {
    if (is) {
      sessionStorage.setItem(KEY, "unconfirmed");
    } else {
      sessionStorage.removeItem(KEY);
    }
  } catch {
    // Storage is not available: a reload loses it.
  }
}

function isKept() {
  try {
    return sessionStorage.getItem(KEY) !== null;
  } catch {
    return false;
  }
}

/** What a server's word means where it has no stop to confirm: the robot stands, as on its station. */
const meaning = (said, link) => (said === "none" ? (link === "up" ? "executed" : "not_confirmed") : said);

/** Returns the buttons, what STOP does, and what is to be said of it; calls `changed` when that may be something else. */
export function emergencyStop(connection, changed) {
  /** When STOP was pressed; null: none waits for its confirmation. */
  let pressed = null;
  /** When the server last answered. */
  let answered = null;
  /** Whether an earlier one held when it was pressed: what is under way then is about that one. */
  let already = false;
  let confirmation = "none";
  let state = null;
  /** The simulated clock stands, so that no robot can confirm anything. */
  let paused = false;
  let requests = new Set();
  let timer = null;

  function engage() {
    if (pressed === null) {
      pressed = stamp();
      answered = null;
      already = state?.emergency_stop ?? false;
      confirmation = "sending";
      connection.stopping = true;
      keep(true);
    }
    repeat();
  }

  function repeat() {
    clearTimeout(timer);
    timer = setTimeout(repeat, AGAIN);
    connection.send({ type: "stop" });
    if (requests.size < MOST) {
      request();
    }
    show();
  }

  async function request() {
    const ended = new AbortController();
    requests.add(ended);
    const limit = setTimeout(() => ended.abort(), TIMEOUT);
    try {
      const answer = await fetch(`${connection.base}/api/stop`, { method: "POST", keepalive: true, priority: "high", signal: ended.signal });
      if (answer.ok) {
        const said = await answer.json();
        hear(meaning(said.stop_confirmation ?? "sending", "up"));
      }
    } catch {
      // The next one may get through.
    }
    clearTimeout(limit);
    requests.delete(ended);
  }

  /** The server has the STOP, and says how far it has come. */
  function hear(said) {
    if (pressed === null) {
      return;
    }
    answered = stamp();
    // Each repetition is on its way at first, but the robot is still out of reach.
    if (said !== "sending" || confirmation !== "not_confirmed") {
      confirmation = said;
    }
    if (said === "executed" || said === "acknowledged" || (said === "sending" && paused)) {
      end();
    }
    show();
  }

  /** Nothing waits any more: it is confirmed, or given up. */
  function end() {
    pressed = null;
    connection.stopping = false;
    keep(false);
    clearTimeout(timer);
    // A late one would stop a robot that somebody has let move again.
    requests.forEach((one) => one.abort());
    requests = new Set();
  }

  /** A key of the texts; null: nothing is to be said. */
  function sentence() {
    if (pressed !== null) {
      if (answered === null || since(answered) > TIMEOUT) {
        return connection.late || since(pressed) > TIMEOUT ? "stop_no_connection" : "stop_sending";
      }
      return confirmation === "not_confirmed" ? "stop_out_of_reach" : "stop_sending";
    }
    if (connection.late || !state?.emergency_stop) {
      return null;
    }
    const unusual = { sending: "stop_sending", acknowledged: "stop_acknowledged", not_confirmed: "stop_out_of_reach" };
    return unusual[confirmation] ?? "stop_executed";
  }

  connection.on("map", ({ clock }) => { paused = clock?.paused ?? false; });

  const words = h("small", { "aria-hidden": "true" });
  const button = h("button", { type: "button", class: "stop", "aria-label": t("stop"), title: t("stop_help"), onclick: engage }, t("stop"), words);
  const giveUp = h("button", {
    type: "button", class: "reset-stop", hidden: true, onclick: () => {
      end();
      show();
    },
  }, t("stop_give_up"));
  const reset = h("button", {
    type: "button", class: "reset-stop driver-only", hidden: true, onclick: () => connection.send({ type: "reset_stop" }),
  }, t("reset_stop"));
  const element = h("div", { class: "emergency-stop" }, reset, giveUp, button);

  function show() {
    const key = sentence();
    say(words, key ? t(`${key}_short`) : "");
    giveUp.hidden = pressed === null || since(pressed) < PATIENCE;
    reset.hidden = pressed !== null || !state?.emergency_stop;
    reset.disabled = connection.late;
    document.body.classList.toggle("stopped", key !== null);
    changed();
  }

  connection.on("state", (now) => {
    state = now;
    const said = meaning(now.stop_confirmation, now.link);
    if (pressed === null) {
      confirmation = said;
    } else if (now.emergency_stop && (!already || answered !== null || since(pressed) > PATIENCE)) {
      hear(said);
    }
    show();
  });
  connection.on("age", show);
  connection.on("open", () => pressed !== null && repeat());
  /** Goes on with one that was not confirmed before the page was loaded again. */
  const resume = () => isKept() && engage();
  return { element, engage, resume, sentence };
}
