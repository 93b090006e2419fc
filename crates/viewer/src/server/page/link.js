// The connection to the program: sends requests, receives pictures. Of several requests only the newest is sent.

// Milliseconds between requests.
const REQUEST_INTERVAL = 16;
// Milliseconds before connecting again: at first, and at most.
const RECONNECT = [250, 4000];

export const token = new URLSearchParams(location.search).get("token");
export const address = (path) => (token ? `${path}${path.includes("?") ? "&" : "?"}token=${encodeURIComponent(token)}` : path);

export class Link {
  // `on`: session(info), picture(header, bitmap), search({ done, count }), error(text), lost(reason).
  constructor(on) {
    this.on = on;
    this.nextId = 1;
    this.pending = null;
    this.sentAt = 0;
    this.reconnectAfter = RECONNECT[0];
    this.shown = Promise.resolve();
    this.connect();
  }

  connect() {
    const socket = new WebSocket(address(`${location.origin.replace(/^http/, "ws")}/socket`));
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onmessage = ({ data }) => {
      if (typeof data !== "string") {
        // In the order of arrival.
        this.shown = this.shown.then(() => this.show(socket, data)).catch((error) => this.on.error(String(error)));
        return;
      }
      const message = JSON.parse(data);
      if ("error" in message) return this.on.error(message.error);
      if ("search" in message) return this.on.search(message.search);
      this.reconnectAfter = RECONNECT[0];
      this.on.session(message);
    };
    socket.onclose = ({ reason }) => {
      this.on.lost(reason);
      setTimeout(() => this.connect(), this.reconnectAfter);
      this.reconnectAfter = Math.min(2 * this.reconnectAfter, RECONNECT[1]);
    };
  }

  async show(socket, data) {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const bitmap = await createImageBitmap(new Blob([new Uint8Array(data, 4 + length)]));
    this.on.picture(header, bitmap);
    bitmap.close();
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ shown: header.id }));
  }

  // Requests a picture; returns the number of the request.
  request(view) {
    if (!this.pending) setTimeout(() => this.send(), this.sentAt + REQUEST_INTERVAL - performance.now());
    this.pending = { id: this.nextId++, ...view };
    return this.pending.id;
  }

  send() {
    const request = this.pending;
    [this.pending, this.sentAt] = [null, performance.now()];
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }
}
