// Threads in Node: the native answers, and an error where a thread ends.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

import * as api from "../js/node.js";
import * as part from "../pkg/threads/splitplane_threads.js";
import { nodeWorker } from "../js/pool-node.js";
import { startPool } from "../js/pool.js";
import { difference, pictures } from "./answers.mjs";
import { failure, refusals, report } from "./threads-answers.mjs";

const snapshot = (name) => readFile(new URL(`../../tests/snapshots/suite__web__${name}.snap`, import.meta.url), "utf8");
const { missing } = part;
const isBuilt = missing === undefined;
const skip = isBuilt ? false : `NOT TESTED: ${missing}`;

test("a package without the part for threads says so, and goes on without", { skip: isBuilt }, async () => {
    const { code, text } = await failure(api, () => api.initThreads());
    assert.equal(code, "threads");
    assert.match(text, /was not built/);
    await api.init();
    assert.equal(api.about().threads, 1);
});

test("threads: refusals first, then the native answers", { skip, timeout: 120_000 }, async () => {
    const { why, isReady, noModule, ...others } = await refusals(api);
    assert.equal(why, null);
    assert.equal(isReady, false);
    const codes = Object.fromEntries(Object.entries(others).map(([name, { code }]) => [name, code]));
    assert.deepEqual(codes, { zero: "config", tooMany: "config", part: "config", text: "type", little: "config", none: "type" });
    assert.equal(noModule.code, "not-ready");
    assert.match(noModule.text, /cannot be loaded/);

    assert.equal(await api.initThreads({ threads: 3 }), 3);
    const found = await report(api);
    assert.equal(found.threads, 3);
    assert.equal(found.again.code, "config");
    assert.match(found.again.text, /loaded already/);
    assert.equal(Object.keys(found.lines).length, 3);
    for (const [name, lines] of Object.entries(found.lines)) assert.equal(difference(lines, await snapshot(name)), null, name);
    assert.ok(found.calls > 5 && found.isOrdered);
    assert.equal(found.ended.code, "cancelled");
    assert.equal(found.little.code, "out-of-memory");
    assert.equal(found.inner, 1);
    assert.deepEqual([found.aborted.code, found.aborted.cause], ["cancelled", "enough"]);
    assert.ok(found.found > 1000);
});

// V8's first compiler alone, always: what it is given while functions are new. See scripts/guard-waits.mjs; without that a fifth to a half of the rounds never end.
test("threads begin in code of the first compiler", { skip, timeout: 120_000 }, () => {
    const program = fileURLToPath(new URL("threads-begins.mjs", import.meta.url));
    const answers = new Set();
    for (let round = 0; round < 12; round += 1) {
        const { status, signal, stdout, stderr } = spawnSync(process.execPath, ["--liftoff-only", program], { encoding: "utf8", timeout: 30_000 });
        assert.equal(status, 0, `round ${round}: ${signal ?? stderr}`);
        answers.add(stdout);
    }
    assert.equal(answers.size, 1);
    assert.equal(JSON.parse([...answers][0]).threads, 3);
});

test("pictures of the page on threads equal the native ones", { skip, timeout: 120_000 }, async () => {
    const raw = await import("../target/page/pkg/threads/splitplane_threads.js");
    const source = await readFile(new URL("../target/page/pkg/threads/splitplane_threads_bg.wasm", import.meta.url));
    const spawn = () => nodeWorker(new URL("threads-page-worker.mjs", import.meta.url));
    const { memory, end } = await startPool(raw, { threads: 3, source, spawn, ended: assert.fail });
    assert.equal(raw.threadCount(), 3);
    assert.equal(difference(pictures({ Page: raw.Page, memory }), await snapshot("web_pictures")), null);
    end();
});

/** What a program of its own prints, as JSON; it must end by itself. */
function program(name, given = [], ...more) {
    const file = fileURLToPath(new URL(name, import.meta.url));
    const { status, stdout, stderr, error } = spawnSync(process.execPath, [...more, file, ...given], { encoding: "utf8", timeout: 60_000 });
    assert.equal(error, undefined, `${name} does not end: ${stderr}`);
    assert.equal(status, 0, stderr);
    return JSON.parse(stdout);
}

test("a thread that traps ends the call that waits for it, and those after it", { skip }, () => {
    const planted = new URL("threads-planted.mjs", import.meta.url).href;
    const { built, later, isReady } = program("threads-dies.mjs", ["1000"], "--import", planted);
    assert.equal(built.code, "crashed");
    assert.match(built.text, /a thread of the compiled part has ended/);
    assert.equal(later.code, "crashed");
    assert.equal(isReady, false);
    // The same program without the planted fault.
    const { built: well, isReady: isAlive } = program("threads-dies.mjs", ["1"]);
    assert.equal(well, null);
    assert.equal(isAlive, true);
});

test("where there is no room for all the memory that could be had, less of it does", { skip }, () => {
    const { refused, threads, granted, digest } = program("threads-little.mjs");
    assert.equal(refused.code, "threads");
    assert.match(refused.text, /no shared memory of 2147483648 bytes .*; try a smaller maxMemory/);
    assert.deepEqual([threads, granted], [2, [2 ** 14]]);
    const none = program("threads-little.mjs", ["none"]);
    assert.equal(none.refused.code, "threads");
    assert.match(none.refused.text, /no shared memory of 33554432 bytes \(no room\)$/);
    assert.deepEqual([none.threads, none.digest], [1, digest]);
});

test("memory that runs out is an error, whichever thread asks for it", { skip }, () => {
    const { codes } = program("threads-memory.mjs");
    assert.ok(codes.includes(null), "small meshes fit");
    assert.ok(codes.some((code) => code !== null), "the largest does not");
    for (const code of codes) assert.ok([null, "out-of-memory", "crashed"].includes(code), code);
});
