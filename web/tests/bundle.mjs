// What a bundler makes of the example has the compiled parts as they are, and no other: node tests/bundle.mjs DIST

import assert from "node:assert/strict";
import { existsSync, readFileSync, readdirSync } from "node:fs";
import path from "node:path";

const assets = path.join(process.argv[2], "assets");
const made = readdirSync(assets).filter((name) => name.endsWith(".wasm")).map((name) => readFileSync(path.join(assets, name)));
const wanted = ["splitplane_bg", "gpu/splitplane_gpu_bg", "threads/splitplane_threads_bg"]
    .map((name) => new URL(`../pkg/${name}.wasm`, import.meta.url))
    // Only the part for threads can be left out, by build.sh.
    .filter((url) => existsSync(url) || !/threads/.test(url.pathname))
    .map((url) => readFileSync(url));
assert.equal(made.length, wanted.length);
for (const part of wanted) assert.ok(made.some((bytes) => bytes.equals(part)), "a compiled part is missing, or another one");
console.log(`${made.length} compiled parts`);
