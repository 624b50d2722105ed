// The connection to the server: state and pictures in, orders out; opened again whenever it is lost.
export type Position = [number, number];
export type Fractions = [number, number, number, number];

export interface Vehicle {
  name: string; connected: boolean; armed: boolean; inAir: boolean; mode: string; battery: number | null;
  height: number | null; heading: number | null; poseRate: number; loss: number | null;
}
export interface Drawn {
  aircraft: { position: Position; heading: number | null; camera: number | null; hfov: number } | null;
  path: Position[]; rays: [Position, Position][]; fence: Position[];
}
export interface State {
  type: "state";
  commander: { name: string; you: boolean } | null;
  vehicle: Vehicle | null;
  video: { state: string; fps: number; age: number | null; note: string } | null;
  busy: boolean;
  following: boolean;
  flight: { stage: string; text: string; for: number; usual: number | null };
  map: Drawn;
  people: { picture: number; boxes: Fractions[] };
}
export interface Target {
  id: string; number: number; name: string; time: string; lat: number; lon: number; altitude: string; mgrs: string;
  ce90: number; le90: number; sure: string; motion: string; distance: number;
  rings: Position[][]; arrow: Position[] | null; picture: boolean; notes: string[];
}
export interface Picture { id: number; age: number; box: Fractions | null; track: string; jpeg: Blob }
export interface Answer { of: string; refused: string }

export interface Handlers {
  hello(you: string, role: string): void;
  map(own: boolean): void;
  state(state: State): void;
  news(lines: { age: number; text: string }[]): void;
  targets(targets: Target[]): void;
  picture(picture: Picture): Promise<void>;
  connected(yes: boolean): void;
}

const AGAIN_MS = 1000;
const SILENT_MS = 4000;

export class Live {
  private socket: WebSocket | null = null;
  private waiting = new Map<number, (answer: Answer) => void>();
  private count = 0;
  private heard = 0;

  constructor(private readonly handlers: Handlers) {
    this.open();
    window.setInterval(() => {
      if (this.socket?.readyState === WebSocket.OPEN && performance.now() - this.heard > SILENT_MS) this.socket.close();
    }, 1000);
  }

  order(kind: string, more: object = {}): Promise<Answer> {
    const socket = this.socket;
    if (socket?.readyState !== WebSocket.OPEN) return Promise.resolve({ of: kind, refused: "the connection is lost" });
    const nr = ++this.count;
    socket.send(JSON.stringify({ type: kind, nr, ...more }));
    return new Promise((resolve) => this.waiting.set(nr, resolve));
  }

  private open(): void {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.heard = performance.now();
      this.handlers.connected(true);
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      this.heard = performance.now();
      if (typeof event.data === "string") this.text(JSON.parse(event.data));
      else void this.picture(socket, event.data);
    };
    socket.onclose = () => {
      this.handlers.connected(false);
      for (const resolve of this.waiting.values()) resolve({ of: "", refused: "the connection is lost" });
      this.waiting.clear();
      window.setTimeout(() => this.again(), AGAIN_MS);
    };
  }

  // A session that has ended (the server was started anew) begins again with the page.
  private again(): void {
    fetch("/targets.csv", { method: "HEAD", cache: "no-store" })
      .then((answer) => (answer.status === 401 ? location.reload() : this.open()))
      .catch(() => window.setTimeout(() => this.again(), AGAIN_MS));
  }

  private text(message: any): void {
    const handlers = this.handlers;
    switch (message.type) {
      case "hello": return handlers.hello(message.you, message.role);
      case "map": return handlers.map(message.own);
      case "state": return handlers.state(message);
      case "news": return handlers.news(message.lines);
      case "targets": return handlers.targets(message.targets);
      case "answer": {
        this.waiting.get(message.to)?.(message);
        this.waiting.delete(message.to);
      }
    }
  }

  private async picture(socket: WebSocket, data: ArrayBuffer): Promise<void> {
    const length = new DataView(data).getUint32(0);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    await this.handlers.picture({ ...header, jpeg: new Blob([new Uint8Array(data, 4 + length)], { type: "image/jpeg" }) });
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type: "ack", id: header.id }));
  }
}
