// The video pane: pictures on a canvas, people to tap, a box to drag. A mark belongs to the picture that it was made in.
import type { Fractions, Picture } from "./live";
import { TEXTS } from "./texts";

export interface Mark { picture: number; box: Fractions }

const CLICK = 0.012;
const PEOPLE_MS = 1500;

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;

export class VideoPane {
  private readonly canvas = element<HTMLCanvasElement>("picture");
  private readonly view = element("stage-view");
  private readonly boxes = element("boxes");
  private readonly drag = element("drag");
  private readonly nothing = element("no-picture");
  private shown = 0;
  private shownAt = 0;
  private people: { picture: number; boxes: Fractions[]; at: number } = { picture: 0, boxes: [], at: 0 };
  private from: { x: number; y: number; picture: number; person: number } | null = null;
  private chosen = -1;
  age = Infinity;
  private mark: Mark | null = null;

  constructor(private readonly marked: (mark: Mark) => void) {
    this.canvas.setAttribute("aria-label", TEXTS.picture);
    this.nothing.textContent = TEXTS.noVideo;
    this.view.addEventListener("pointerdown", (event) => this.down(event));
    this.view.addEventListener("pointermove", (event) => this.move(event));
    this.view.addEventListener("pointerup", (event) => this.up(event));
    this.view.addEventListener("pointercancel", () => this.cancel());
    this.canvas.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && this.chosen >= 0) this.markPerson(this.chosen);
    });
    new ResizeObserver(() => this.place()).observe(this.view);
  }

  async show(picture: Picture): Promise<void> {
    const image = await createImageBitmap(picture.jpeg);
    if (this.canvas.width !== image.width || this.canvas.height !== image.height) {
      this.canvas.width = image.width;
      this.canvas.height = image.height;
      this.place();
    }
    const pen = this.canvas.getContext("2d");
    if (pen) {
      pen.drawImage(image, 0, 0);
      if (picture.box) this.draw(pen, picture.box, picture.track);
    }
    image.close();
    this.shown = picture.id;
    this.shownAt = performance.now();
    this.age = picture.age;
    this.nothing.hidden = true;
    this.drawPeople(picture.box !== null);
  }

  // What is shown when pictures stop.
  quiet(text: string): void {
    if (performance.now() - this.shownAt > 2000) {
      this.nothing.textContent = text;
      this.nothing.hidden = false;
      this.age = Infinity;
    }
  }

  see(people: { picture: number; boxes: Fractions[] }): void {
    if (people.picture !== this.people.picture) this.people = { ...people, at: performance.now() };
  }

  next(): void {
    if (!this.people.boxes.length) return;
    this.chosen = (this.chosen + 1) % this.people.boxes.length;
    this.canvas.focus();
    this.drawPeople(false);
  }

  unmark(): void {
    this.mark = null;
    this.chosen = -1;
    this.drag.hidden = true;
  }

  private draw(pen: CanvasRenderingContext2D, [left, top, right, bottom]: Fractions, track: string): void {
    const { width, height } = this.canvas;
    pen.lineWidth = Math.max(2, width / 220);
    for (const [colour, extra] of [["#000a", 3], [track === "tracking" ? "#ffb547" : "#ff5a52", 0]] as const) {
      pen.strokeStyle = colour;
      pen.lineWidth = Math.max(2, width / 260) + extra;
      const [x, y, w, h] = [left * width, top * height, (right - left) * width, (bottom - top) * height];
      const c = Math.min(w, h) * 0.3;
      pen.beginPath();
      for (const [cx, cy, sx, sy] of [[x, y, 1, 1], [x + w, y, -1, 1], [x + w, y + h, -1, -1], [x, y + h, 1, -1]] as const) {
        pen.moveTo(cx + sx * c, cy);
        pen.lineTo(cx, cy);
        pen.lineTo(cx, cy + sy * c);
      }
      pen.stroke();
    }
  }

  private drawPeople(following: boolean): void {
    const fresh = performance.now() - this.people.at < PEOPLE_MS && !following;
    const wanted = fresh ? this.people.boxes : [];
    while (this.boxes.children.length > wanted.length) this.boxes.lastElementChild?.remove();
    wanted.forEach((box, index) => {
      let button = this.boxes.children[index] as HTMLButtonElement | undefined;
      if (!button) {
        button = document.createElement("button");
        button.type = "button";
        button.onclick = (event) => event.detail === 0 && this.markPerson(index); // by the keyboard; else see up()
        this.boxes.append(button);
      }
      button.classList.toggle("chosen", index === this.chosen);
      button.setAttribute("aria-label", TEXTS.person(index + 1, wanted.length));
      this.put(button, box);
    });
  }

  private markPerson(index: number): void {
    const box = this.people.boxes[index];
    if (box) this.set({ picture: this.people.picture, box });
  }

  private set(mark: Mark): void {
    this.mark = mark;
    this.put(this.drag, mark.box);
    this.drag.hidden = false;
    this.marked(mark);
  }

  private put(item: HTMLElement, [left, top, right, bottom]: Fractions): void {
    const at = this.canvas.getBoundingClientRect(), view = this.view.getBoundingClientRect();
    item.style.left = `${at.left - view.left + left * at.width}px`;
    item.style.top = `${at.top - view.top + top * at.height}px`;
    item.style.width = `${(right - left) * at.width}px`;
    item.style.height = `${(bottom - top) * at.height}px`;
  }

  private place(): void {
    const view = this.view.getBoundingClientRect();
    const scale = Math.min(view.width / this.canvas.width, view.height / this.canvas.height);
    this.canvas.style.width = `${this.canvas.width * scale}px`;
    this.canvas.style.height = `${this.canvas.height * scale}px`;
    if (this.mark) this.put(this.drag, this.mark.box);
  }

  private point(event: PointerEvent): { x: number; y: number } {
    const at = this.canvas.getBoundingClientRect();
    return { x: (event.clientX - at.left) / at.width, y: (event.clientY - at.top) / at.height };
  }

  private down(event: PointerEvent): void {
    if (event.button !== 0 || !this.shown) return;
    const person = [...this.boxes.children].indexOf((event.target as HTMLElement).closest("#boxes button") ?? this.boxes);
    const at = this.point(event);
    if (at.x < 0 || at.x > 1 || at.y < 0 || at.y > 1) return;
    this.from = { ...at, picture: this.shown, person };
    this.view.setPointerCapture(event.pointerId);
    event.preventDefault();
  }

  private move(event: PointerEvent): void {
    if (!this.from || this.isTap(this.between(this.point(event)))) return;
    this.put(this.drag, this.between(this.point(event)));
    this.drag.hidden = false;
  }

  private up(event: PointerEvent): void {
    const from = this.from;
    if (!from) return;
    const box = this.between(this.point(event));
    this.from = null;
    const tap = this.isTap(box);
    if (tap && from.person >= 0) this.markPerson(from.person);
    else this.set({ picture: from.picture, box: tap ? [from.x, from.y, from.x, from.y] : box });
    this.drag.classList.toggle("tap", tap);
  }

  private isTap(box: Fractions): boolean {
    return box[2] - box[0] < CLICK && box[3] - box[1] < CLICK;
  }

  private cancel(): void {
    this.from = null;
    this.drag.hidden = this.mark === null;
  }

  private between(to: { x: number; y: number }): Fractions {
    const from = this.from ?? { x: 0, y: 0 };
    const cut = (value: number) => Math.min(1, Math.max(0, value));
    return [Math.min(from.x, cut(to.x)), Math.min(from.y, cut(to.y)), Math.max(from.x, cut(to.x)), Math.max(from.y, cut(to.y))];
  }
}
