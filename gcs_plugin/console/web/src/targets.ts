// The list of located targets.
import type { Target } from "./live";
import { TEXTS } from "./texts";

export interface Actions {
  show(target: Target): void;
  copy(text: string): void;
  give(what: "roi" | "waypoint"): void;
}

export class TargetPane {
  private readonly list = document.getElementById("target-list") as HTMLOListElement;
  private ages: { element: HTMLElement; time: number }[] = [];

  constructor(private readonly actions: Actions) {
    window.setInterval(() => this.tick(), 1000);
    this.fill([]);
  }

  fill(targets: Target[]): void {
    this.ages = [];
    if (!targets.length) {
      const nothing = document.createElement("li");
      nothing.className = "nothing";
      nothing.textContent = TEXTS.noTargets;
      this.list.replaceChildren(nothing);
      return;
    }
    const newest = targets.at(-1);
    this.list.replaceChildren(...targets.toReversed().map((target) => this.item(target, target === newest)));
    this.tick();
  }

  choose(target: Target): void {
    const item = this.list.querySelector<HTMLElement>(`[data-id="${CSS.escape(target.id)}"]`);
    this.list.querySelectorAll(".chosen").forEach((other) => other.classList.remove("chosen"));
    item?.classList.add("chosen");
    item?.scrollIntoView({ block: "nearest" });
  }

  private item(target: Target, newest: boolean): HTMLLIElement {
    const item = document.createElement("li");
    item.dataset.id = target.id;
    const head = document.createElement("h3");
    const age = document.createElement("time");
    age.dateTime = target.time;
    head.append(target.name, age);
    this.ages.push({ element: age, time: Date.parse(target.time) });
    const facts = document.createElement("div");
    facts.className = "facts";
    const sure = document.createElement("p");
    sure.className = "sure";
    sure.textContent = TEXTS.ce90(target.ce90, target.sure);
    const moving = document.createElement("p");
    moving.textContent = `${target.motion[0]?.toUpperCase() ?? ""}${target.motion.slice(1)}; ${TEXTS.away(target.distance)}`;
    facts.append(sure, moving);
    const body = document.createElement("div");
    body.className = "body";
    if (target.picture) {
      const picture = document.createElement("img");
      picture.src = `/targets/${target.number}/picture`;
      picture.alt = TEXTS.pictureOf(target.name);
      picture.loading = "lazy";
      body.append(picture);
    }
    body.append(facts);
    const degrees = `${target.lat.toFixed(7)}, ${target.lon.toFixed(7)}`;
    const places = document.createElement("div");
    places.className = "places";
    places.append(this.copier(degrees, TEXTS.copyDegrees), this.copier(target.mgrs, TEXTS.copyGrid));
    const buttons = document.createElement("div");
    buttons.className = "buttons";
    buttons.append(this.button(TEXTS.show, () => this.actions.show(target)));
    if (newest) {
      buttons.append(this.button(TEXTS.lookAt, () => this.actions.give("roi")));
      buttons.append(this.button(TEXTS.waypoint, () => this.actions.give("waypoint")));
    }
    item.append(head, body, places, buttons);
    return item;
  }

  private copier(text: string, label: string): HTMLButtonElement {
    const button = this.button(text, () => this.actions.copy(text));
    button.className = "copy";
    button.setAttribute("aria-label", `${label}: ${text}`);
    return button;
  }

  private button(text: string, act: () => void): HTMLButtonElement {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = text;
    button.onclick = act;
    return button;
  }

  private tick(): void {
    for (const { element, time } of this.ages) element.textContent = TEXTS.ago((Date.now() - time) / 1000);
  }
}
