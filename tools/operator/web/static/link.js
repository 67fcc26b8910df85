// The one WebSocket: states and events in, beats and requests out.
//
// A beat carries all that is held. Beats come from this thread's timer alone, so that a page that
// hangs, or is hidden, falls silent; the console then ends its motion, and the lease runs out.

const BEAT_HELD_MS = 10;
const BEAT_IDLE_MS = 100;
const AGAIN_MS = 700;
const UNANSWERED_MS = 7000;
/** The quickest of so many beats tells how the console's clock stands to the page's. */
const BEATS_COMPARED = 50;
const VIDEO_HEAD = 12;

export class Link extends EventTarget {
  constructor(name) {
    super();
    this.name = name;
    this.open = false;
    this.latency = null;
    this.echo = null;
    this.lapsed = false;
    this._held = {};
    this._watched = {};
    this._clocks = [];
    this._daemon = null;
    this._holding = false;
    this._number = 0;
    this._beats = new Map();
    this._waiting = new Map();
    this._beatAt = 0;
    this._dial();
    setInterval(() => this._beatIfDue(), BEAT_HELD_MS);
  }

  // Held: {topic: fields}. Sent at once where it changed, and with every beat.
  hold(held) {
    this._held = held;
    this._holding = Object.keys(held).length > 0;
    this._beat();
  }

  // Watched: {camera: number of its newest frame that has come}. Sent with every beat.
  watch(cameras) {
    const before = this._watched;
    this._watched = cameras;
    if (Object.keys(cameras).join() !== Object.keys(before).join()) this._beat();
  }

  // Returns how old is what was seen in a tick of the daemon [ms]; null while the clocks are unknown.
  // The console's clock is the quickest echo's; the daemon's ticks are told on that clock.
  ageOf(tick) {
    if (!this._daemon || !this._clocks.length) return null;
    const { ahead } = this._clocks.reduce((a, b) => (b.trip < a.trip ? b : a));
    const { zero_ms: zero, period_ms: period } = this._daemon;
    return performance.now() + ahead - (zero + tick * period) + (this.echo ?? 0) / 2;
  }

  // Returns a promise of {ok, reason, detail, words}; it never rejects.
  send(key, fields = {}) {
    const id = ++this._number;
    return new Promise((resolve) => {
      const reply = (answer) => {
        this._waiting.delete(id);
        resolve(answer);
        if (!answer.ok) this.dispatchEvent(new CustomEvent("refused", { detail: { key, ...answer } }));
      };
      if (!this._put({ type: "send", id, key, fields })) {
        reply({ ok: false, reason: "no_console", words: "The console does not answer." });
        return;
      }
      this._waiting.set(id, reply);
      setTimeout(() => {
        if (this._waiting.has(id)) {
          reply({ ok: false, reason: "no_answer", words: "Nobody answered in time." });
        }
      }, UNANSWERED_MS);
    });
  }

  rename(name) {
    this.name = name;
    this._socket.close();
  }

  _dial() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const query = new URLSearchParams({ name: this.name });
    this._socket = new WebSocket(`${scheme}://${location.host}/ws?${query}`);
    this._socket.onopen = () => this._opened(true);
    this._socket.binaryType = "arraybuffer";
    this._socket.onmessage = ({ data }) => (typeof data === "string" ? this._take(JSON.parse(data)) : this._film(data));
    this._socket.onclose = () => {
      if (this.open) this._opened(false);
      for (const reply of [...this._waiting.values()]) {
        reply({ ok: false, reason: "no_console", words: "The link to the console was lost." });
      }
      setTimeout(() => this._dial(), AGAIN_MS);
    };
  }

  _opened(open) {
    this.open = open;
    this.latency = this.echo = null;
    this._beats.clear();
    this._clocks = [];
    this.dispatchEvent(new CustomEvent("open", { detail: open }));
  }

  _put(message) {
    if (!this.open) return false;
    this._socket.send(JSON.stringify(message));
    return true;
  }

  _beatIfDue() {
    const due = this._holding ? BEAT_HELD_MS : BEAT_IDLE_MS;
    if (performance.now() - this._beatAt >= due - 2) this._beat();
  }

  _beat() {
    const n = ++this._number;
    this._beatAt = performance.now();
    if (this._beats.size < 1000) this._beats.set(n, this._beatAt);
    this._put({ type: "beat", n, held: this._held, video: this._watched });
  }

  _take(message) {
    if (message.type === "beat") {
      const sent = this._beats.get(message.n);
      this._beats.delete(message.n);
      if (sent !== undefined) this._answered(sent, message);
      this.echo = message.echo_ms;
      if (message.lapsed && this._holding) this.dispatchEvent(new CustomEvent("lapsed"));
    } else if (message.type === "reply") {
      this._waiting.get(message.id)?.(message);
    } else {
      this.dispatchEvent(new CustomEvent(message.type, { detail: message }));
    }
  }

  _answered(sent, message) {
    const trip = (this.latency = performance.now() - sent);
    if (message.zero_ms === undefined) return;
    this._daemon = message;
    this._clocks.push({ trip, ahead: message.now_ms - (sent + trip / 2) });
    if (this._clocks.length > BEATS_COMPARED) this._clocks.shift();
  }

  // A frame of a video: key, length of the camera's name, 0, number, tick; the name; H.264.
  _film(buffer) {
    const head = new DataView(buffer);
    const begin = VIDEO_HEAD + head.getUint8(1);
    const detail = {
      key: head.getUint8(0) === 1, number: head.getUint32(4, true), tick: head.getUint32(8, true),
      camera: new TextDecoder().decode(new Uint8Array(buffer, VIDEO_HEAD, begin - VIDEO_HEAD)),
      data: new Uint8Array(buffer, begin),
    };
    this.dispatchEvent(new CustomEvent("video", { detail }));
  }
}
