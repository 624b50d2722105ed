// Builds the page into ../page, which the Python package ships. Run it by `npm ci && npm run build`; see docs/console.md.
import { build } from "esbuild";
import { copyFile, mkdir, readFile, rm, writeFile } from "node:fs/promises";

const page = new URL("../page/", import.meta.url).pathname;
await rm(page, { recursive: true, force: true });
await mkdir(page, { recursive: true });
const common = { bundle: true, minify: true, legalComments: "none", target: "es2022", format: "esm", charset: "utf8" };
await build({ ...common, entryPoints: ["src/main.ts"], outfile: `${page}main.js` });
await build({
  ...common,
  entryPoints: ["node_modules/maplibre-gl/dist/maplibre-gl-worker.mjs"],
  outfile: `${page}map-worker.js`,
});
await build({ ...common, entryPoints: ["src/style.css"], outfile: `${page}style.css`, loader: { ".svg": "dataurl" } });
for (const name of ["index.html", "login.html", "icon.svg"]) await copyFile(`src/${name}`, `${page}${name}`);
const notices = ["maplibre-gl", "pmtiles"].map(async (name) => {
  const folder = `node_modules/${name}/`;
  const { version, license } = JSON.parse(await readFile(`${folder}package.json`, "utf8"));
  const text = await readFile(`${folder}LICENSE.txt`, "utf8").catch(() => readFile(`${folder}LICENSE`, "utf8")).catch(() => "");
  return `${name} ${version} (${license})\n\n${text}`;
});
await writeFile(`${page}licenses.txt`, (await Promise.all(notices)).join("\n\n----\n\n"));
