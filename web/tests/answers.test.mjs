// In Node: equal to the native library, bit for bit.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";

import * as api from "../js/node.js";
import { all, difference, pictures } from "./answers.mjs";

const snapshot = (name) => readFile(new URL(`../../tests/snapshots/suite__web__${name}.snap`, import.meta.url), "utf8");

await api.init();

test("digests, hits, points and files equal the native ones", async () => {
    for (const [name, lines] of Object.entries(all(api))) assert.equal(difference(lines, await snapshot(name)), null, name);
});

test("a planted difference is found", async () => {
    const text = await snapshot("web_instances");
    const lines = text.trimEnd().split("---\n").slice(2).join("---\n").split("\n");
    assert.equal(difference(lines, text), null);
    const last = lines.length - 1;
    assert.match(difference([...lines.slice(0, last), `${lines[last]}0`], text), /natively/);
    assert.match(difference(lines.slice(0, last), text), /undefined/);
});

test("pictures equal the native ones", async () => {
    const raw = await import("../target/page/pkg/splitplane.js");
    const bytes = await readFile(new URL("../target/page/pkg/splitplane_bg.wasm", import.meta.url));
    const { memory } = await raw.default({ module_or_path: bytes });
    assert.equal(difference(pictures({ Page: raw.Page, memory }), await snapshot("web_pictures")), null);
});
