// What the pages of a class ask of their server.

import { h, say } from "/dom.js";
import { addTexts, t } from "/texts.js";
import { TEXTS } from "./texts.js";

addTexts(TEXTS);

const AGAIN = 1000;
const LIMIT = 90_000;

/** Sends a request with a JSON body. Resolves to `{ ok, status, ...answer }`; `error` says what is wrong. */
export async function ask(path, body, { method = "POST", keepalive = false } = {}) {
  try {
    const answer = await fetch(path, {
      method, keepalive, signal: AbortSignal.timeout(LIMIT),
      ...(body === undefined ? {} : { headers: { "content-type": "application/json" }, body: JSON.stringify(body) }),
    });
    const said = await answer.json().catch(() => ({}));
    return { ...(Array.isArray(said) ? { list: said } : said), ok: answer.ok, status: answer.status };
  } catch {
    return { ok: false, status: 0, error: "" };
  }
}

/** Sends a request to the class; `show` gets a sentence if it fails. */
export async function post(what, body, show) {
  const answer = await ask(`/class/${what}`, body);
  if (!answer.ok) {
    show(answer.error || t("server_lost"));
  }
}

/** Fetches something as JSON. */
export const fetchJson = (path) => ask(path, undefined, { method: "GET" });

/** What the server last said about the caller; null: it does not know the caller. */
export async function me() {
  const answer = await fetch("/class/me");
  return answer.json();
}

/** Calls `show` with each new state, `lost` while there is no connection, and `out` when the server no longer knows
 *  the caller. */
export function follow(show, lost, out) {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(`${scheme}://${location.host}/class/events`);
  socket.onmessage = ({ data }) => {
    lost(false);
    show(JSON.parse(data));
  };
  socket.onclose = async () => {
    const still = await me().catch(() => undefined);
    if (still === null) {
      return out();
    }
    lost(true);
    setTimeout(() => follow(show, lost, out), AGAIN);
  };
}

/** A banner, and `lost`, which shows in it whether there is a connection. */
export function connectionBanner() {
  const banner = h("p", { class: "banner", role: "alert", hidden: true });
  const lost = (is) => {
    banner.hidden = !is;
    say(banner, is ? t("server_lost") : "");
  };
  return { banner, lost };
}
