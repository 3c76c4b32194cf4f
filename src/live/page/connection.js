// The WebSocket: knows by the page's own clock when nothing arrives any more, closes a dead one, dials again, and
// passes messages on by their type.

import { since, stamp } from "./dom.js";

const FIRST_PAUSE = 300;
const LONGEST_PAUSE = 2000;
/** The server says something twice a second. After this time the page says that there is no connection; milliseconds. */
const LATE = 1500;
/** The pause of a page that had to make room for others; milliseconds. */
const EVICTED_PAUSE = 10000;
/** After this time without a message, or without an answer to a dial, the socket is closed. */
const DEAD = 3000;
const CHECK = 250;
/** What may be sent while STOP is not confirmed, or nothing arrives. */
const HARMLESS = ["stop", "watch", "frame_shown", "name"];

/** Passes each message to the listeners for its type; `frame`, `open`, `lost` and `age` are types too. */
export class Connection {
  /** What stands before the paths of the run that it shows: a class has many runs. */
  base;
  /** Whether a STOP is not confirmed yet: then nothing else is sent, and pauses between dials are short. */
  stopping = false;
  /** Whether the server has closed this page's connection for another page. */
  evicted = false;
  #listeners = new Map();
  #socket = null;
  #pause = FIRST_PAUSE;
  #dialling = null;
  #answers = new Map();
  #number = 0;
  #closed = false;
  #watch = {};
  /** When the last message arrived, or the socket was made. */
  #arrived = stamp();
  /** When the newest heartbeat was sent, by this page's clock. */
  #heard = stamp();
  /** This page's time minus the server's, of the heartbeat that was fastest. */
  #offset = Infinity;

  constructor(base = "") {
    this.base = base;
    setInterval(() => this.#check(), CHECK);
    // After sleep, at once.
    for (const [target, kind] of [[window, "pageshow"], [window, "online"], [document, "visibilitychange"]]) {
      target.addEventListener(kind, () => {
        this.#check();
        this.connect();
      });
    }
  }

  on(kind, listener) {
    this.#listeners.set(kind, [...(this.#listeners.get(kind) ?? []), listener]);
  }

  #tell(kind, value) {
    for (const listener of this.#listeners.get(kind) ?? []) {
      listener(value);
    }
  }

  /** Milliseconds since the server has sent the newest message. */
  get age() {
    return since(this.#heard);
  }

  /** Whether nothing arrives. */
  get late() {
    return this.age >= LATE;
  }

  /** Opens the socket, if there is none. */
  connect() {
    if (this.#socket || this.#closed) {
      return;
    }
    clearTimeout(this.#dialling);
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}${this.base}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.#pause = FIRST_PAUSE;
      this.#offset = Infinity;
      this.#arrived = stamp();
      this.#heard = stamp();
      this.send({ type: "watch", ...this.#watch });
      this.#tell("open");
      this.#check();
    };
    socket.onmessage = ({ data }) => this.#take(data);
    socket.onclose = () => this.#lose();
    this.#arrived = stamp();
    this.#socket = socket;
  }

  /** Closes it until it is opened again. */
  close() {
    this.#closed = true;
    if (this.#socket) {
      this.#lose();
    }
  }

  /** Opens it to the run that is there now. */
  reopen(base = this.base) {
    this.close();
    this.base = base;
    this.#closed = false;
    this.#pause = FIRST_PAUSE;
    this.connect();
  }

  /** Gives the socket up. The browser itself notices a dead one only after minutes. */
  #lose() {
    const socket = this.#socket;
    this.#socket = null;
    socket.onopen = null;
    socket.onmessage = null;
    socket.onclose = null;
    socket.close();
    for (const answer of this.#answers.values()) {
      answer({ ok: false, text: "" });
    }
    this.#answers.clear();
    this.#dialling = setTimeout(() => this.connect(), this.stopping ? FIRST_PAUSE : this.evicted ? EVICTED_PAUSE : this.#pause);
    this.#pause = Math.min(LONGEST_PAUSE, this.#pause * 2);
    this.#tell("lost");
  }

  #check() {
    if (this.#socket && since(this.#arrived) >= DEAD) {
      this.#lose();
    }
    this.#tell("age", this.age);
  }

  #take(data) {
    this.#arrived = stamp();
    if (data instanceof ArrayBuffer) {
      const head = new DataView(data);
      const frame = { number: head.getUint32(0), age: head.getUint32(4), jpeg: data.slice(8) };
      return this.#tell("frame", frame);
    }
    const message = JSON.parse(data);
    if (message.type === "heartbeat") {
      const offset = performance.now() - message.milliseconds;
      this.#offset = Math.min(this.#offset, offset);
      this.#heard = stamp(offset - this.#offset);
    }
    if (message.type === "hello") {
      this.evicted = false;
    }
    if (message.type === "notice" && message.key === "evicted") {
      this.evicted = true;
    }
    if (message.type === "answer") {
      this.#answers.get(message.id)?.(message);
      this.#answers.delete(message.id);
    }
    this.#tell(message.type, message);
  }

  /** Sends a message. Returns whether it was sent. */
  send(message) {
    const stands = message.type === "drive" && message.left === 0 && message.right === 0;
    const allowed = stands || HARMLESS.includes(message.type) || (!this.stopping && !this.late);
    if (!allowed || this.#socket?.readyState !== WebSocket.OPEN) {
      return false;
    }
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  /** Changes which parts the page shows. */
  watch(change) {
    this.#watch = { ...this.#watch, ...change };
    this.send({ type: "watch", ...this.#watch });
  }

  /** Sends a command. Resolves to its answer with `ok` and `text`. */
  command(command) {
    this.#number += 1;
    const id = this.#number;
    return new Promise((resolve) => {
      this.#answers.set(id, resolve);
      if (!this.send({ type: "command", id, command })) {
        this.#answers.delete(id);
        resolve({ ok: false, text: "" });
      }
    });
  }
}
