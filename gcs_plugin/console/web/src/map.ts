// The map pane: a metre grid, or the user's own PMTiles, and on it the aircraft, its rays and the targets.
import { addProtocol, Map as MapView, Marker, ScaleControl, setWorkerUrl, type GeoJSONSource, type LayerSpecification, type StyleSpecification } from "maplibre-gl";
import type { Feature, FeatureCollection } from "geojson";
import { PMTiles, Protocol } from "pmtiles";
import type { Drawn, Position, Target } from "./live";

setWorkerUrl("/map-worker.js");

const EARTH_M = 6371008.8;
const SOURCES = ["grid", "fence", "view", "rays", "path", "ellipses", "arrows"] as const;
type Source = (typeof SOURCES)[number];
const STEPS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000];

export interface Colours { ground: string; grid: string; ray: string; path: string; fence: string; ellipse: string; arrow: string; view: string }

const line = (coordinates: Position[]): Feature => ({ type: "Feature", properties: {}, geometry: { type: "LineString", coordinates } });
const area = (ring: Position[], properties = {}): Feature => ({ type: "Feature", properties, geometry: { type: "Polygon", coordinates: [ring] } });
const collection = (features: Feature[]): FeatureCollection => ({ type: "FeatureCollection", features });

export class MapPane {
  private readonly view: MapView;
  private readonly craft: Marker;
  private readonly markers = new Map<string, { marker: Marker; at: string }>();
  private origin: Position | null = null;
  private ready = false;
  private own = false;
  private listed = false;
  private drawn: Drawn | null = null;
  private targets: Target[] = [];
  private given: Partial<Record<Source, string>> = {};
  following = true;

  constructor(private colours: Colours, private readonly chosen: (target: Target) => void, private readonly freed: () => void) {
    this.view = new MapView({
      container: "map",
      style: this.style(),
      center: [0, 0],
      zoom: 1,
      maxZoom: 24,
      attributionControl: false,
      dragRotate: false,
      pitchWithRotate: false,
      fadeDuration: 0,
    });
    this.view.touchZoomRotate.disableRotation();
    this.view.keyboard.disableRotation();
    this.view.addControl(new ScaleControl({ maxWidth: 140, unit: "metric" }), "bottom-left");
    this.view.on("load", () => {
      this.ready = true;
      this.redraw();
    });
    this.view.on("moveend", () => this.drawGrid());
    this.view.on("dragstart", () => {
      this.following = false;
      this.freed();
    });
    const shape = document.createElement("div");
    shape.className = "craft";
    shape.innerHTML = '<svg viewBox="0 0 48 48" aria-hidden="true"><path d="M24 4 38 42 24 34 10 42Z"/></svg>';
    this.craft = new Marker({ element: shape, rotationAlignment: "map" });
    Object.assign(window, { sidestepMap: this.view });
  }

  setColours(colours: Colours): void {
    this.colours = colours;
    this.ready = false;
    this.given = {};
    this.view.setStyle(this.style(), { diff: false });
    this.view.once("styledata", () => {
      this.ready = true;
      void this.addOwnMap();
      this.redraw();
    });
  }

  useOwnMap(): void {
    if (this.own) return;
    this.own = true;
    const add = () => void this.addOwnMap();
    if (this.ready) add();
    else this.view.once("load", add);
  }

  draw(drawn: Drawn): void {
    this.drawn = drawn;
    if (drawn.aircraft) {
      const { position, heading } = drawn.aircraft;
      if (!this.origin) {
        this.origin = position;
        this.view.jumpTo({ center: position, zoom: 20 });
        this.craft.setLngLat(position).addTo(this.view);
      }
      this.craft.setLngLat(position).setRotation(heading ?? 0);
      if (this.following && !this.view.isMoving() && this.metres(this.view.getCenter().toArray() as Position, position) > 0.5)
        this.view.easeTo({ center: position, duration: 180, essential: true });
    }
    this.redraw();
  }

  show(targets: Target[]): void {
    const first = !this.listed, before = this.targets.at(-1)?.id;
    this.listed = true;
    this.targets = targets;
    const kept = new Set(targets.map((target) => target.id));
    for (const [id, { marker }] of this.markers) {
      if (kept.has(id)) continue;
      marker.remove();
      this.markers.delete(id);
    }
    for (const target of targets) {
      const at = `${target.lat},${target.lon},${target.number}`;
      if (this.markers.get(target.id)?.at === at) continue;
      this.markers.get(target.id)?.marker.remove();
      const button = document.createElement("button");
      button.type = "button";
      button.className = "pin";
      button.setAttribute("aria-label", `${target.name}, CE90 ${target.ce90.toFixed(1)} m`);
      const label = document.createElement("span");
      label.textContent = String(target.number || "?");
      button.append(label);
      button.onclick = () => this.chosen(target);
      this.markers.set(target.id, { marker: new Marker({ element: button, anchor: "center" }).setLngLat([target.lon, target.lat]).addTo(this.view), at });
    }
    const newest = targets.at(-1);
    if (newest && !first && before !== newest.id) this.goTo(newest);
    else if (newest && first && !this.origin) this.view.jumpTo({ center: [newest.lon, newest.lat], zoom: 19.5 });
    this.redraw();
  }

  goTo(target: Target): void {
    const here = this.drawn?.aircraft?.position;
    const near = here && this.metres(here, [target.lon, target.lat]) < 200;
    this.following = false;
    this.freed();
    const lon = near ? [here[0], target.lon] : [target.lon, target.lon], lat = near ? [here[1], target.lat] : [target.lat, target.lat];
    const pad = (5 / EARTH_M) * (180 / Math.PI);
    this.view.fitBounds(
      [[Math.min(...lon) - pad, Math.min(...lat) - pad], [Math.max(...lon) + pad, Math.max(...lat) + pad]],
      { padding: 60, maxZoom: 21, duration: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 600 },
    );
  }

  private redraw(): void {
    if (!this.ready) return;
    const drawn = this.drawn;
    if (drawn) {
      this.set("fence", drawn.fence.length ? [line(drawn.fence)] : []);
      this.set("rays", drawn.rays.map((ray) => line(ray)));
      this.set("path", drawn.path.length > 1 ? [line(drawn.path)] : []);
      const craft = drawn.aircraft;
      this.set("view", craft && craft.camera !== null ? [area(this.cone(craft.position, craft.camera, craft.hfov))] : []);
    }
    this.set("ellipses", this.targets.flatMap((target) => target.rings.map((ring) => area(ring))));
    this.set("arrows", this.targets.flatMap((target) => (target.arrow ? [line(target.arrow)] : [])));
    this.drawGrid();
  }

  private drawGrid(): void {
    const origin = this.origin ?? (this.targets[0] ? ([this.targets[0].lon, this.targets[0].lat] as Position) : null);
    if (!this.ready || !origin) return;
    if (this.own) return this.set("grid", []);
    const bounds = this.view.getBounds();
    const perLat = (Math.PI / 180) * EARTH_M, perLon = perLat * Math.cos((origin[1] * Math.PI) / 180);
    const [west, east] = [bounds.getWest(), bounds.getEast()].map((lon) => (lon - origin[0]) * perLon) as [number, number];
    const [south, north] = [bounds.getSouth(), bounds.getNorth()].map((lat) => (lat - origin[1]) * perLat) as [number, number];
    const spare = 0.5; // of the view, on each side: so that it need not be drawn while the map moves
    const step = STEPS.find((each) => (east - west) / each < 14) ?? 20000;
    if ((east - west) / step > 60) return this.set("grid", []);
    const place = (x: number, y: number): Position => [origin[0] + x / perLon, origin[1] + y / perLat];
    const lines: Feature[] = [];
    const [wide, high] = [spare * (east - west), spare * (north - south)];
    for (let x = Math.floor((west - wide) / step) * step; x <= east + wide; x += step) lines.push(line([place(x, south - high), place(x, north + high)]));
    for (let y = Math.floor((south - high) / step) * step; y <= north + high; y += step) lines.push(line([place(west - wide, y), place(east + wide, y)]));
    this.set("grid", lines);
    const container = this.view.getContainer();
    container.dataset.grid = step >= 1000 ? `grid ${step / 1000} km` : `grid ${step} m`;
  }

  private set(name: Source, features: Feature[]): void {
    const text = JSON.stringify(features);
    if (this.given[name] === text) return; // drawing costs the browser more than comparing
    this.given[name] = text;
    (this.view.getSource(name) as GeoJSONSource | undefined)?.setData(collection(features));
  }

  private cone([lon, lat]: Position, camera: number, hfov: number): Position[] {
    const perLat = (Math.PI / 180) * EARTH_M, perLon = perLat * Math.cos((lat * Math.PI) / 180);
    const ring: Position[] = [[lon, lat]];
    for (let part = -0.5; part <= 0.501; part += 0.125) {
      const angle = ((camera + part * hfov) * Math.PI) / 180;
      ring.push([lon + (12 * Math.sin(angle)) / perLon, lat + (12 * Math.cos(angle)) / perLat]);
    }
    return [...ring, [lon, lat]];
  }

  private metres(a: Position, b: Position): number {
    const perLat = (Math.PI / 180) * EARTH_M;
    return Math.hypot((a[0] - b[0]) * perLat * Math.cos((a[1] * Math.PI) / 180), (a[1] - b[1]) * perLat);
  }

  private style(): StyleSpecification {
    const c = this.colours;
    const stroke = (source: Source, colour: string, width: number, more: object = {}): LayerSpecification =>
      ({ id: source, type: "line", source, paint: { "line-color": colour, "line-width": width, ...more } });
    return {
      version: 8,
      sources: Object.fromEntries(SOURCES.map((name) => [name, { type: "geojson", data: collection([]) }])),
      layers: [
        { id: "ground", type: "background", paint: { "background-color": c.ground } },
        stroke("grid", c.grid, 1),
        { id: "view", type: "fill", source: "view", paint: { "fill-color": c.view, "fill-opacity": 0.16 } },
        stroke("fence", c.fence, 2, { "line-dasharray": [3, 2] }),
        stroke("rays", c.ray, 1.5, { "line-opacity": 0.55 }),
        stroke("path", c.path, 3),
        { id: "ellipse-fill", type: "fill", source: "ellipses", paint: { "fill-color": c.ellipse, "fill-opacity": 0.28 } },
        stroke("ellipses", c.ellipse, 2.5),
        stroke("arrows", c.arrow, 4),
      ],
    };
  }

  // The user's own map under everything: pictures as they are, vector tiles of the usual schemas in plain colours.
  private async addOwnMap(): Promise<void> {
    if (!this.own || this.view.getSource("own")) return;
    const tiles = new PMTiles(`${location.origin}/map.pmtiles`);
    const protocol = new Protocol();
    protocol.add(tiles);
    addProtocol("pmtiles", protocol.tile);
    const vector = (await tiles.getHeader()).tileType === 1;
    this.view.addSource("own", { type: vector ? "vector" : "raster", url: `pmtiles://${location.origin}/map.pmtiles`, ...(vector ? {} : { tileSize: 256 }) } as never);
    if (!vector) this.view.addLayer({ id: "own", type: "raster", source: "own" }, "grid");
    else
      for (const [layers, kind, colour] of [
        [["earth", "landuse", "landcover", "park", "natural"], "fill", "#77996618"],
        [["water"], "fill", "#2f6fa866"],
        [["buildings", "building"], "fill", "#8f8f8f55"],
        [["waterway"], "line", "#2f6fa8"],
        [["roads", "transportation"], "line", "#a9a9a9"],
        [["boundaries", "boundary"], "line", "#8866aa"],
      ] as const)
        for (const name of layers)
          this.view.addLayer(
            { id: `own-${name}`, type: kind, source: "own", "source-layer": name, paint: { [`${kind}-color`]: colour } } as LayerSpecification,
            "grid",
          );
  }
}
