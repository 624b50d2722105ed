// The console: puts the panes together and turns what the operator does into orders.
import { Live, type State, type Target } from "./live";
import { MapPane, type Colours } from "./map";
import { TargetPane } from "./targets";
import { TEXTS } from "./texts";
import { VideoPane, type Mark } from "./video";

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const STAGES = ["detect", "hover", "centre", "sidestep", "estimate", "report"];
const THEME = "sidestep-theme";

let role = "viewer";
let you = false;
let state: State | null = null;
let lastTargets: Target[] = [];

const abort = element<HTMLButtonElement>("abort");
const command = element<HTMLButtonElement>("command");
const theme = element<HTMLButtonElement>("theme");
const follow = element<HTMLButtonElement>("follow");
const confirm = element("confirm");
const toast = element("toast");
let toastTimer = 0;

function label(): void {
  element("video-title").textContent = TEXTS.video;
  element("map-title").textContent = TEXTS.map;
  element("targets-title").textContent = TEXTS.targets;
  element("export").textContent = TEXTS.export;
  element("locate").textContent = TEXTS.locate;
  element("unmark").textContent = TEXTS.unmark;
  element("confirm-text").textContent = TEXTS.marked;
  follow.textContent = TEXTS.follow;
  abort.innerHTML = "";
  const strong = document.createElement("strong"), hint = document.createElement("kbd");
  strong.textContent = TEXTS.abort;
  hint.textContent = TEXTS.abortHint;
  abort.append(strong, hint);
  (element("log").querySelector("summary") as HTMLElement).textContent = TEXTS.log;
  element("exports").replaceChildren(
    ...Object.entries(TEXTS.exports).map(([ending, text]) => {
      const item = document.createElement("li"), link = document.createElement("a");
      link.href = `/targets.${ending}`;
      link.download = `targets.${ending}`;
      link.textContent = text;
      item.append(link);
      return item;
    }),
  );
  element("steps").replaceChildren(
    ...STAGES.map((stage) => {
      const item = document.createElement("li");
      item.dataset.stage = stage;
      item.textContent = TEXTS.stages[stage]?.[0] ?? stage;
      return item;
    }),
  );
}

function say(text: string, bad = false): void {
  toast.textContent = text;
  toast.classList.toggle("bad", bad);
  toast.hidden = false;
  window.clearTimeout(toastTimer);
  toastTimer = window.setTimeout(() => (toast.hidden = true), bad ? 7000 : 3000);
}

async function order(kind: string, done: string, more: object = {}): Promise<boolean> {
  const answer = await live.order(kind, more);
  if (answer.refused) say(TEXTS.refused(answer.refused), true);
  else if (done) say(done);
  return !answer.refused;
}

async function copy(text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  say(TEXTS.copied(text));
}

function colours(): Colours {
  const style = getComputedStyle(document.documentElement);
  const get = (name: string) => style.getPropertyValue(`--map-${name}`).trim();
  return { ground: get("ground"), grid: get("grid"), ray: get("ray"), path: get("path"), fence: get("fence"), ellipse: get("ellipse"), arrow: get("arrow"), view: get("view") };
}

function setTheme(name: string): void {
  document.documentElement.dataset.theme = name;
  theme.textContent = name === "dark" ? TEXTS.bright : TEXTS.dark;
  theme.setAttribute("aria-pressed", String(name !== "dark"));
  localStorage.setItem(THEME, name);
}

// Who is marked is followed at once, without flying, so that the mark stays on the person until Locate is pressed.
async function marked(mark: Mark): Promise<void> {
  if (role !== "commander") say(TEXTS.idleViewer);
  else if (state?.flight.stage) say(TEXTS.flying);
  else await order("mark", "", { picture: mark.picture, box: mark.box });
  video.unmark();
}

async function locate(): Promise<void> {
  await order("locate", TEXTS.ordered);
}

function showConfirm(now: State): void {
  const shown = now.following && role === "commander";
  if (shown === !confirm.hidden) return;
  confirm.hidden = !shown;
  if (shown) element("locate").focus({ preventScroll: true });
}

function chip(text: string, kind: "" | "warn" | "bad" = ""): HTMLLIElement {
  const item = document.createElement("li");
  item.textContent = text;
  item.className = kind;
  return item;
}

function showChips(now: State): void {
  const chips: HTMLLIElement[] = [];
  const { vehicle, video: stream } = now;
  if (!vehicle || !vehicle.connected) chips.push(chip(TEXTS.chips.noLink, "bad"));
  else {
    chips.push(chip(TEXTS.chips.mode(vehicle.mode, vehicle.armed, vehicle.inAir)));
    if (vehicle.height !== null) chips.push(chip(TEXTS.chips.height(vehicle.height)));
    if (vehicle.battery !== null) chips.push(chip(TEXTS.chips.battery(vehicle.battery), vehicle.battery < 0.3 ? "bad" : vehicle.battery < 0.4 ? "warn" : ""));
    chips.push(chip(TEXTS.chips.link(vehicle.poseRate, vehicle.loss), (vehicle.loss ?? 0) > 0.1 ? "warn" : ""));
  }
  if (stream && Number.isFinite(video.age)) chips.push(chip(TEXTS.chips.video(stream.fps, video.age), video.age > 0.7 ? "warn" : ""));
  else chips.push(chip(TEXTS.chips.noVideo, "warn"));
  const list = element("chips");
  const text = chips.map((each) => each.className + each.textContent).join("|");
  if (list.dataset.text !== text) {
    list.dataset.text = text;
    list.replaceChildren(...chips);
  }
}

function sentence(now: State): string {
  if (!now.vehicle) return TEXTS.noDrone;
  if (!now.vehicle.connected) return TEXTS.connectionLost;
  const stage = now.flight.stage;
  if (stage) {
    const told = TEXTS.stages[stage]?.[1] ?? now.flight.text;
    return stage === "sidestep" || stage === "centre" || stage === "hover" ? `${told} ${TEXTS.pilot}` : told;
  }
  if (role !== "commander") return TEXTS.idleViewer;
  if (now.following) return TEXTS.following;
  return now.vehicle.inAir ? TEXTS.idle : TEXTS.idleGround;
}

function showFlight(now: State): void {
  const stage = now.flight.stage, at = STAGES.indexOf(stage);
  document.body.classList.toggle("flying", Boolean(stage));
  element("steps").querySelectorAll<HTMLLIElement>("li").forEach((item, index) => {
    item.className = index < at || stage === "hold" ? "done" : index === at ? "now" : "";
    const usual = now.flight.usual;
    const part = index === at && usual ? Math.min(1, now.flight.for / usual) : 0;
    item.style.setProperty("--part", `${100 * part}%`);
    item.dataset.left = index === at && usual ? TEXTS.left(usual - now.flight.for) : "";
  });
  const text = sentence(now), line = element("sentence");
  if (line.textContent !== text) line.textContent = text;
}

function showCommand(now: State): void {
  you = now.commander?.you ?? false;
  element("commander").textContent = role !== "commander" ? TEXTS.viewer : you ? TEXTS.youCommand : now.commander ? TEXTS.commands(now.commander.name) : TEXTS.nobody;
  command.hidden = role !== "commander";
  command.textContent = you ? TEXTS.release : TEXTS.take;
  command.disabled = Boolean(now.commander) && !you;
}

setTheme(localStorage.getItem(THEME) ?? "dark");
const map = new MapPane(colours(), (target) => targets.choose(target), () => follow.setAttribute("aria-pressed", "false"));
const video = new VideoPane((mark) => void marked(mark));
const targets = new TargetPane({
  show: (target) => {
    map.goTo(target);
    targets.choose(target);
  },
  copy: (text) => void copy(text),
  give: (what) => void order("give", TEXTS.ordered, { what }),
});
const live = new Live({
  hello: (_, mine) => {
    role = mine;
    abort.disabled = role !== "commander";
    document.body.dataset.role = role;
  },
  map: (own) => own && map.useOwnMap(),
  state: (now) => {
    state = now;
    showChips(now);
    showFlight(now);
    showCommand(now);
    showConfirm(now);
    map.draw(now.map);
    video.see(now.people);
    video.quiet(now.video ? TEXTS.waitVideo : TEXTS.noVideo);
  },
  news: (lines) => {
    const list = element("news");
    for (const { age, text } of lines) {
      const item = document.createElement("li"), time = document.createElement("time");
      time.textContent = new Date(Date.now() - 1000 * age).toLocaleTimeString();
      item.append(time, text);
      list.prepend(item);
    }
    while (list.children.length > 60) list.lastElementChild?.remove();
  },
  targets: (found) => {
    lastTargets = found;
    targets.fill(found);
    map.show(found);
    const newest = found.at(-1), place = element("place");
    place.hidden = !newest;
    if (newest) {
      const head = document.createElement("p"), title = document.createElement("strong"), sure = document.createElement("span");
      head.append(title, sure);
      title.textContent = newest.name;
      sure.textContent = `CE90 ${newest.ce90.toFixed(1)} m`;
      const spots = [`${newest.lat.toFixed(7)}, ${newest.lon.toFixed(7)}`, newest.mgrs].map((text) => {
        const button = document.createElement("button");
        button.type = "button";
        button.className = "copy";
        button.textContent = text;
        button.onclick = () => void copy(text);
        return button;
      });
      place.replaceChildren(head, ...spots);
    }
  },
  picture: (picture) => video.show(picture),
  connected: (yes) => {
    document.body.dataset.connected = String(yes);
    if (!yes) {
      element("sentence").textContent = TEXTS.lost;
      video.quiet(TEXTS.noVideo);
      element("chips").replaceChildren(chip(TEXTS.chips.noLink, "bad"));
      element("chips").dataset.text = "";
    }
  },
});

label();
abort.onclick = () => void order("abort", TEXTS.aborted);
element("locate").onclick = () => void locate();
element("unmark").onclick = () => void order("unmark", "");
command.onclick = () => void order(you ? "release" : "take", "");
theme.onclick = () => {
  setTheme(document.documentElement.dataset.theme === "dark" ? "bright" : "dark");
  map.setColours(colours());
};
follow.onclick = () => {
  map.following = !map.following;
  follow.setAttribute("aria-pressed", String(map.following));
};
element("export").onclick = () => {
  const list = element("exports");
  list.hidden = !list.hidden;
  element("export").setAttribute("aria-expanded", String(!list.hidden));
};
window.addEventListener("keydown", (event) => {
  if (event.key === "Escape") {
    if (role === "commander") void order("abort", TEXTS.aborted);
  } else if (event.target instanceof HTMLInputElement || event.ctrlKey || event.metaKey || event.altKey) return;
  else if (event.key === "l" && state?.following) void locate();
  else if (event.key === "n") video.next();
});
Object.assign(window, { sidestepTargets: () => lastTargets });
