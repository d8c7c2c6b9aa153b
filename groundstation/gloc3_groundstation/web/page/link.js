// A websocket to the station that lasts: it watches the station's beats, and reconnects with back-off.
//
// It is what textual.js uses as its WebSocket, so that the terminal outlives every single connection.

const SILENT_MS = 2000; // without a beat, after which the page says that the station does not answer
const ABANDON_MS = 4000; // after which a silent connection is given up for a new one
const ATTEMPT_MS = 3000; // that an attempt may take
const CHECK_MS = 200;
const BACK_OFF_MS = [250, 500, 1000, 2000, 4000];

export class StationLink extends EventTarget {
  #address; #hello; #socket = null; #attempt = 0; #nextMs = 0; #begunMs = 0; #heardMs = performance.now();
  #beat = null; #wasUp = true; #why = "";

  /** @param address the websocket's URL. @param hello returns the page's introduction, for each connection. */
  constructor(address, hello) {
    super();
    this.#address = address;
    this.#hello = hello;
    this.isUp = false; // whether beats come
    this.station = null; // which run of the station the page belongs to
  }

  /** Begins to connect. */
  open() {
    this.#heardMs = performance.now();
    setInterval(() => this.#check(), CHECK_MS);
    addEventListener("online", () => this.#hurry());
    document.addEventListener("visibilitychange", () => document.hidden || this.#hurry());
    this.#connect();
  }

  /** How long no beat has come, in milliseconds. */
  get silentMs() { return performance.now() - this.#heardMs; }

  /** Milliseconds to the next attempt; 0 while one is under way. */
  get waitMs() { return this.#socket ? 0 : Math.max(0, this.#nextMs - performance.now()); }

  /** Why the station closed the last connection; empty where it did not say. */
  get why() { return this.#why; }

  /** Sends a command with the beat that it refers to; returns false where the station cannot be reached. */
  command(...message) {
    if (!this.isUp || this.silentMs > SILENT_MS) return false;
    return this.send(...message, this.#beat);
  }

  /** Sends what may come late. */
  send(...message) {
    if (this.#socket?.readyState !== WebSocketOfBrowser.OPEN) return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  #connect() {
    const socket = this.#socket = new WebSocketOfBrowser(this.#address);
    this.#begunMs = performance.now();
    socket.binaryType = "arraybuffer";
    socket.onopen = () => socket === this.#socket && this.send("hello", this.#hello());
    socket.onmessage = (event) => socket === this.#socket && this.#receive(event.data);
    socket.onclose = (event) => {
      if (socket !== this.#socket) return;
      this.#why = event.reason;
      this.#lose();
    };
  }

  #receive(data) {
    if (typeof data !== "string") return this.dispatchEvent(new MessageEvent("message", { data }));
    const [kind, ...values] = JSON.parse(data);
    if (kind === "beat") {
      this.#beat = values[0];
      this.#heardMs = performance.now();
      this.#attempt = 0;
      this.#check();
    } else if (kind === "hello") {
      if (this.station !== null && this.station !== values[0].station) return location.reload();
      this.station = values[0].station;
      this.dispatchEvent(new CustomEvent("hello", { detail: values[0] }));
    } else {
      this.dispatchEvent(new CustomEvent(kind, { detail: values }));
    }
  }

  #check() {
    const nowMs = performance.now();
    const isOpen = this.#socket?.readyState === WebSocketOfBrowser.OPEN;
    this.isUp = isOpen && this.#beat !== null && this.silentMs <= SILENT_MS;
    if (this.isUp !== this.#wasUp || !this.isUp) this.dispatchEvent(new Event("state"));
    this.#wasUp = this.isUp;
    if (this.#socket && nowMs - this.#begunMs > (isOpen ? ABANDON_MS : ATTEMPT_MS) && this.silentMs > ABANDON_MS)
      this.#lose();
    else if (!this.#socket && nowMs >= this.#nextMs) this.#connect();
  }

  #lose() {
    const socket = this.#socket;
    this.#socket = this.#beat = null;
    socket?.close();
    this.#nextMs = performance.now() + BACK_OFF_MS[Math.min(this.#attempt++, BACK_OFF_MS.length - 1)];
    this.dispatchEvent(new Event("lost"));
    this.#check();
  }

  #hurry() {
    this.#attempt = 0;
    this.#nextMs = Math.min(this.#nextMs, performance.now());
    this.#check();
  }
}

const WebSocketOfBrowser = WebSocket;

/** The address of a websocket beside the page. */
export function beside(path) {
  const address = new URL(path, location.href);
  address.protocol = address.protocol.replace("http", "ws");
  address.search = "";
  return address.href;
}
