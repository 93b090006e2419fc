// The connection to the program: wishes out, pictures in. Of several wishes only the newest is sent, and not more than the program takes.

// Milliseconds between wishes.
const APART = 16;

export const token = new URLSearchParams(location.search).get("token");
export const address = (path) => (token ? `${path}${path.includes("?") ? "&" : "?"}token=${encodeURIComponent(token)}` : path);

export class Link {
  // `on`: hello(told), picture(header, bitmap), refused(text), lost(reason), open().
  constructor(on) {
    this.on = on;
    this.next = 1;
    this.wish = null;
    this.sent = 0;
    this.wait = 250;
    this.shown = Promise.resolve();
    this.connect();
  }

  connect() {
    const socket = new WebSocket(address(`${location.origin.replace(/^http/, "ws")}/socket`));
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onmessage = ({ data }) => {
      if (typeof data !== "string") {
        // One after the other, in the order in which they came.
        this.shown = this.shown.then(() => this.show(socket, data)).catch((error) => this.on.refused(String(error)));
        return;
      }
      const told = JSON.parse(data);
      if ("error" in told) return this.on.refused(told.error);
      this.wait = 250;
      this.on.hello(told);
    };
    socket.onclose = ({ reason }) => {
      this.on.lost(reason);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(2 * this.wait, 4000);
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

  // Wishes for a picture; returns its number.
  look(wish) {
    if (!this.wish) setTimeout(() => this.send(), this.sent + APART - performance.now());
    this.wish = { id: this.next++, ...wish };
    return this.wish.id;
  }

  send() {
    const wish = this.wish;
    [this.wish, this.sent] = [null, performance.now()];
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(wish));
  }
}
