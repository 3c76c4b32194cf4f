// The WebSocket: reconnects when it is lost, and passes messages on by their type.

const FIRST_PAUSE = 300;
const LONGEST_PAUSE = 5000;

/** Passes each message to the listeners for its type; `frame`, `open` and `lost` are types too. */
export class Connection {
  #listeners = new Map();
  #socket = null;
  #pause = FIRST_PAUSE;
  #answers = new Map();
  #number = 0;
  #watch = {};

  on(kind, listener) {
    this.#listeners.set(kind, [...(this.#listeners.get(kind) ?? []), listener]);
  }

  #tell(kind, value) {
    for (const listener of this.#listeners.get(kind) ?? []) {
      listener(value);
    }
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.#pause = FIRST_PAUSE;
      this.send({ type: "watch", ...this.#watch });
      this.#tell("open");
    };
    socket.onmessage = ({ data }) => this.#take(data);
    socket.onclose = () => {
      this.#socket = null;
      for (const answer of this.#answers.values()) {
        answer({ ok: false, text: "" });
      }
      this.#answers.clear();
      this.#tell("lost");
      setTimeout(() => this.connect(), this.#pause);
      this.#pause = Math.min(LONGEST_PAUSE, this.#pause * 2);
    };
    this.#socket = socket;
  }

  #take(data) {
    if (data instanceof ArrayBuffer) {
      const head = new DataView(data);
      const frame = { number: head.getUint32(0), age: head.getUint32(4), jpeg: data.slice(8) };
      return this.#tell("frame", frame);
    }
    const message = JSON.parse(data);
    if (message.type === "answer") {
      this.#answers.get(message.id)?.(message);
      this.#answers.delete(message.id);
    }
    this.#tell(message.type, message);
  }

  /** Sends a message. Returns whether the connection is open. */
  send(message) {
    if (this.#socket?.readyState !== WebSocket.OPEN) {
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
