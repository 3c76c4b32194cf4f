// Logging in: with the token of a link, or one that a person pastes.

import { FETCH_LIMIT, h, say } from "./dom.js";
import { t } from "./texts.js";

/** Fetches the visitor's role, and whether no login is needed: `{ role, open }`. */
export async function me() {
  const answer = await fetch("/api/me", { signal: AbortSignal.timeout(FETCH_LIMIT) });
  return answer.json();
}

/** Ends the session. */
export async function logOut() {
  await fetch("/api/logout", { method: "POST" });
  location.reload();
}

/** Exchanges a token for a cookie. Returns `{ role, open }`, or `{ error }`. */
async function logIn(token) {
  const answer = await fetch("/api/login", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ token }),
  });
  return answer.json();
}

/** Logs in with the token of a link such as `http://robot:7788/#token=...`, which then vanishes from the address. */
export async function logInByLink() {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (token === null) {
    return {};
  }
  history.replaceState(null, "", location.pathname);
  return logIn(token);
}

/** Shows the login form; resolves after a successful login. */
export function askForToken(app, mistake = "") {
  return new Promise((resolve) => {
    const input = h("input", { id: "token", type: "password", autocomplete: "off", required: true });
    const trouble = h("p", { class: "trouble", role: "alert" }, mistake);
    const submit = async (event) => {
      event.preventDefault();
      const said = await logIn(input.value.trim());
      if (said.role) {
        return resolve(said);
      }
      say(trouble, said.error);
      input.select();
    };
    app.replaceChildren(h("main", { class: "login" },
      h("form", { class: "card", onsubmit: submit },
        h("img", { src: "/icon.svg", alt: "", width: 48, height: 48 }),
        h("h1", {}, "spykee"),
        h("label", { for: "token" }, t("token")), input,
        h("button", { class: "primary" }, t("login")),
        trouble,
        h("p", { class: "quiet" }, t("login_hint")))));
    input.focus();
  });
}
