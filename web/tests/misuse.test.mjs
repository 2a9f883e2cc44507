// Wrong arguments of every kind, made up by a generator: each call ends well or in a SplitplaneError, and the package works afterwards.

import assert from "node:assert/strict";
import { test } from "node:test";

import * as api from "../js/node.js";
import { Numbers, rays, sphere } from "./meshes.mjs";

const { Scene, SplitplaneError, Tree, WasmArray } = api;

test("before init() every call says so", () => {
    assert.equal(api.isReady(), false);
    assert.throws(() => Tree.build(new Float32Array(9)), { name: "SplitplaneError", code: "not-ready" });
    assert.throws(() => new Scene(), { code: "not-ready" });
    assert.throws(() => new WasmArray(3), { code: "not-ready" });
});

test("a compiled part that is none is refused, and another one is taken", async () => {
    await assert.rejects(api.init(Uint8Array.of(1, 2, 3)), { name: "SplitplaneError", code: "not-ready" });
    await api.init();
    assert.equal(api.isReady(), true);
});

const { positions, indices } = sphere(6);
const make = () => Tree.build(positions, indices);

const wrong = (work, code, text) => assert.throws(work, (error) => {
    assert.ok(error instanceof SplitplaneError, String(error));
    assert.equal(error.code, code, error.message);
    assert.match(error.message, text);
    assert.ok(api.CODES.includes(error.code));
    return true;
});

test("each error has its code and the library's text", () => {
    wrong(() => Tree.build([0, 0, 0]), "type", /positions must be a Float32Array or a WasmArray, but is Array/);
    wrong(() => Tree.build(positions, [0, 1, 2]), "type", /indices must be a Uint32Array/);
    wrong(() => Tree.build(new Float32Array(10), indices), "shape", /multiple of 3/);
    wrong(() => Tree.build(new Float32Array(12)), "shape", /multiple of 9/);
    wrong(() => Tree.build(positions, new Uint32Array(4)), "shape", /multiple of 3/);
    wrong(() => Tree.build(positions, Uint32Array.of(0, 1, 9999)), "mesh", /triangle 0 names vertex 9999/);
    wrong(() => Tree.build(positions, indices, { preset: "quick" }), "config", /no preset `quick`/);
    wrong(() => Tree.build(positions, indices, { layout: "wide" }), "config", /no layout `wide`/);
    wrong(() => Tree.build(positions, indices, { maxMemory: NaN }), "config", /maxMemory is NaN/);
    wrong(() => Tree.build(positions, indices, { maxMemory: 1000 }), "out-of-memory", /raise the limit/);
    wrong(() => Tree.build(positions, indices, { progress: 1 }), "type", /progress must be a function/);
    wrong(() => Tree.build(positions, indices, { signal: 1 }), "type", /signal must be an AbortSignal/);
    wrong(() => Tree.build(positions, indices, { signal: AbortSignal.abort("enough") }), "cancelled", /before it began/);
    wrong(() => Tree.build(positions, indices, { progress: () => false }), "cancelled", /cancelled in the/);
    wrong(() => new Tree(), "type", /Tree\.build/);
    wrong(() => new WasmArray(-1), "config", /whole number/);
    wrong(() => new WasmArray(0xfffffff0), "out-of-memory", /no memory for/);
    wrong(() => Tree.load(Uint8Array.of(1, 2), positions, indices), "file", /magic/);
    const tree = make();
    const bytes = tree.toBytes(positions, indices);
    const other = positions.map((x) => x * 2);
    wrong(() => Tree.load(bytes, other, indices), "wrong-mesh", /another mesh/);
    wrong(() => Tree.load(bytes.slice(0, -4), positions, indices), "file", /bytes/);
    wrong(() => tree.toBytes(positions, indices.subarray(3)), "wrong-mesh", /triangles/);
    wrong(() => tree.closestHits(new Float32Array(9)), "shape", /multiple of 8/);
    wrong(() => tree.closestHits(rays(4, 1), { accuracy: "best" }), "config", /no accuracy `best`/);
    wrong(() => tree.closestHits(rays(4, 1), { culling: 1 }), "config", /no culling `1`/);
    wrong(() => tree.closestHits(rays(4, 1), { ignore: 1.5 }), "config", /ignore is 1.5/);
    wrong(() => tree.closestHits(rays(4, 1), { into: new Float32Array(16) }), "type", /WasmArray/);
    wrong(() => tree.closestHits(rays(4, 1), null), "type", /options must be an object, but is null/);
    const both = new WasmArray(32);
    wrong(() => tree.closestHits(both, { into: both }), "type", /one of their own/);
    both.free();
    const small = new WasmArray(3);
    wrong(() => tree.closestHits(rays(4, 1), { into: small }), "shape", /3 words, but the answers take 16/);
    wrong(() => tree.closestHit([0, 0], [0, 0, 1]), "type", /three numbers/);
    wrong(() => tree.closestHit([0, 0, "1"], [0, 0, 1]), "type", /three numbers/);
    wrong(() => tree.allHits(rays(4, 1), { maxMemory: 1 }), "out-of-memory", /raise the limit/);
    wrong(() => tree.closestPoints(new Float32Array(3), { maxDistance: -1 }), "config", /maxDistance/);
    wrong(() => tree.closestPoints(new Float32Array(3), { accuracy: "exact" }), "config", /not offered/);
    wrong(() => tree.closestPoints(new Float32Array(3), { accuracy: "Fast" }), "config", /no accuracy/);
    tree.free();
    small.free();
    wrong(() => tree.digest, "freed", /Tree was freed/);
    wrong(() => tree.closestHits(rays(1, 1)), "freed", /Tree was freed/);
    wrong(() => small.floats, "freed", /WasmArray was freed/);
    tree.free();
    const scene = new Scene();
    wrong(() => scene.addInstance(0, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]), "unknown", /geometry/);
    const geometry = scene.addGeometry(positions, indices);
    wrong(() => scene.addInstance(geometry, [1, 2, 3]), "shape", /3 numbers/);
    wrong(() => scene.addInstance(geometry, new Float32Array(12)), "scene", /transform|inverse/);
    wrong(() => scene.closestHits(rays(1, 1)), "stale", /update\(\)/);
    scene.update();
    wrong(() => scene.moveInstance(7, new Float32Array(12)), "unknown", /instance/);
    scene.free();
});

test("a scene whose update failed answers as before it, and keeps the edits", () => {
    const matrix = (x) => [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0];
    const larger = positions.map((part) => 2 * part);
    const asked = rays(200, 1);
    const answers = (own) => {
        const hits = own.closestHits(asked);
        const kinds = ["t", "u", "v", "triangle", "geometry", "instance"].map((name) => Array.from(hits[name]));
        return JSON.stringify([own.digest, kinds, Array.from(own.anyHits(asked)), Array.from(own.anyHits(asked, { mask: 2 }))]);
    };
    const begun = () => {
        const own = new Scene();
        const geometry = own.addGeometry(positions, indices);
        own.addInstance(geometry, matrix(0), { mask: 1 });
        own.addInstance(geometry, matrix(3), { mask: 2 });
        own.update();
        return own;
    };
    const edit = (own) => {
        own.moveInstance(0, matrix(0.25));
        own.removeInstance(1);
        own.addInstance(own.addGeometry(larger, indices), matrix(1), { mask: 2 });
    };
    const fresh = begun();
    edit(fresh);
    fresh.update();
    const failures = [{ maxMemory: 500 }, { progress: () => false }];
    for (const [place, code] of ["out-of-memory", "cancelled"].entries()) {
        const own = begun();
        const before = answers(own);
        edit(own);
        wrong(() => own.closestHits(asked), "stale", /update\(\)/);
        wrong(() => own.update(failures[place]), code, /answers as before the update$/);
        assert.equal(answers(own), before);
        wrong(() => own.moveInstance(0, new Float32Array(12)), "scene", /transform|inverse/);
        assert.equal(answers(own), before);
        own.update();
        assert.equal(answers(own), answers(fresh));
        assert.notEqual(answers(own), before);
        own.free();
    }
    fresh.free();
});

test("an exception of the progress callback is passed on, and the work has ended", () => {
    const own = new RangeError("mine");
    const failing = () => {
        throw own;
    };
    assert.throws(() => Tree.build(positions, indices, { progress: failing }), (error) => error === own);
    const tree = make();
    assert.throws(() => tree.allHits(rays(10, 1), { progress: failing }), (error) => error === own);
    assert.throws(() => tree.closestHits(rays(10, 1), { progress: failing }), (error) => error === own);
    // Within the callback other work can be done.
    let inner = null;
    Tree.build(positions, indices, { progress: () => void (inner ??= make().digest) }).free();
    assert.equal(inner, tree.digest);
    tree.free();
});

test("what an object's own progress callback cannot do to it ends in an error", () => {
    const tree = make();
    const before = tree.digest;
    const codes = (works) => works.map((work) => {
        try {
            work();
            return null;
        } catch (error) {
            assert.ok(error instanceof SplitplaneError, error.stack);
            return error.code;
        }
    });
    const ray = [[0, 0, 5], [0, 0, -1]];
    let seen = null;
    // While it changes, it answers nothing.
    const all = [() => tree.digest, () => tree.closestHit(...ray), () => tree.allHits(rays(1, 1)), () => tree.rebuild(positions, indices), () => tree.free()];
    tree.rebuild(positions, indices, { progress: () => void (seen ??= codes(all)) });
    assert.deepEqual(seen, all.map(() => "busy"));
    // While it is asked, it can be asked, and not changed; arrays that are in use stay.
    seen = null;
    const asked = new WasmArray(8 * 20);
    asked.floats.set(rays(20, 1));
    const some = [() => tree.digest, () => tree.closestHit(...ray), () => tree.allHits(rays(1, 1)), () => tree.rebuild(positions, indices), () => tree.free(), () => asked.free()];
    tree.allHits(asked, { progress: () => void (seen ??= codes(some)) });
    assert.deepEqual(seen, [null, null, null, "busy", "busy", "busy"]);
    const scene = new Scene();
    scene.addInstance(scene.addGeometry(positions, indices), [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]);
    seen = null;
    const edits = [() => scene.addGeometry(positions, indices), () => scene.closestHits(rays(1, 1)), () => scene.update(), () => scene.free()];
    scene.update({ progress: () => void (seen ??= codes(edits)) });
    assert.deepEqual(seen, edits.map(() => "busy"));
    // All are as alive as before.
    assert.equal(tree.digest, before);
    assert.equal(scene.closestHits(rays(5, 1)).t.length, 5);
    for (const one of [tree, asked, scene]) one.free();
});

test("views that have ended are refused, and those of the module's own memory are read", async () => {
    const tree = make();
    const asked = rays(50, 1);
    const wanted = tree.closestHits(asked);
    const kept = new WasmArray(asked.length);
    kept.floats.set(asked);
    assert.deepEqual(tree.closestHits(kept.floats), wanted);
    // So large that the memory grows while a view of it is copied.
    const large = new WasmArray(30_000_000);
    large.floats.set(asked);
    const found = tree.anyHits(large.floats);
    assert.deepEqual(Array.from(found.slice(0, 50)), Array.from(wanted.triangle, (triangle) => Number(triangle !== api.NONE)));
    const view = kept.floats;
    const more = [];
    while (view.length > 0) more.push(new WasmArray(20_000_000));
    assert.throws(() => tree.closestHits(view), { code: "type", message: /a view that has ended/ });
    assert.throws(() => Tree.build(view), { code: "type" });
    const given = rays(50, 1);
    structuredClone(given, { transfer: [given.buffer] });
    assert.throws(() => tree.closestHits(given), { code: "type", message: /a view that has ended/ });
    assert.throws(() => tree.contains(new Float32Array(3), { into: kept }), { code: "config" });
    await assert.rejects(tree.containsAsync(new Float32Array(3), { into: kept }), { code: "config" });
    for (const one of [tree, kept, large, ...more]) one.free();
});

test("asynchronous batches answer the same, let others run, and can be aborted", async () => {
    const { positions, indices } = sphere(40);
    const tree = Tree.build(positions, indices);
    const asked = rays(400_000, 1);
    const wanted = tree.closestHits(asked);
    let turns = 0;
    const timer = setInterval(() => (turns += 1), 1);
    const seen = [];
    const found = await tree.closestHitsAsync(asked, { progress: (stage, done, total) => void seen.push([stage, done, total]) });
    clearInterval(timer);
    assert.deepEqual(found, wanted);
    const points = rays(400, 1).filter((_, place) => place % 8 < 3);
    const inside = await tree.containsAsync(points);
    assert.deepEqual(inside, tree.contains(points));
    assert.ok(inside.includes(0) && inside.includes(1));
    assert.ok(turns > 3, `the event loop had ${turns} turns`);
    assert.deepEqual(seen[0], ["rays", 0, 400_000]);
    assert.deepEqual(seen.at(-1), ["rays", 400_000, 400_000]);
    const controller = new AbortController();
    setTimeout(() => controller.abort("enough"), 5);
    await assert.rejects(tree.closestHitsAsync(asked, { signal: controller.signal }), { code: "cancelled", cause: "enough" });
    // Changed while it is asked: answers of two trees are not mixed.
    const mixed = tree.closestHitsAsync(asked);
    await new Promise((resume) => setTimeout(resume, 5));
    tree.rebuild(positions, indices);
    await assert.rejects(mixed, { code: "busy" });
    assert.deepEqual(await tree.closestHitsAsync(asked), wanted);
    // Freed while it is asked.
    const later = tree.anyHitsAsync(asked);
    await new Promise((resume) => setTimeout(resume, 5));
    tree.free();
    await assert.rejects(later, { code: "freed" });
});

test("arrays of the module's memory are asked about without a copy", () => {
    const tree = make();
    const given = rays(1000, 1);
    const [asked, into] = [new WasmArray(8000), new WasmArray(4000)];
    asked.floats.set(given);
    assert.equal(tree.closestHits(asked, { into }), into);
    const wanted = tree.closestHits(given);
    for (let i = 0; i < 1000; i += 1) {
        assert.equal(into.words[4 * i + 1], wanted.triangle[i]);
        assert.equal(into.floats[4 * i], wanted.t[i]);
        const single = tree.closestHit(given.subarray(8 * i, 8 * i + 3), given.subarray(8 * i + 4, 8 * i + 7), { tMax: 4 });
        assert.equal(single?.t ?? Infinity, wanted.t[i]);
    }
    assert.throws(() => tree.closestHits(asked, { into: asked }));
    assert.deepEqual(tree.closestHits(given), wanted);
    for (const own of [asked, into, tree]) own.free();
});

test("two thousand made-up calls end well or in an error of the package", () => {
    const numbers = new Numbers(99);
    const below = (count) => Math.floor(((numbers.next() + 1) / 2) * count) % count;
    const odd = [
        undefined, null, NaN, -1, 0, 1.5, Infinity, "", "fast", {}, [], [1, 2, 3], new Float32Array(0), new Float32Array(3), new Float32Array(8),
        new Float32Array(9).fill(NaN), new Float32Array(24).fill(1e38), new Float64Array(9), new Uint32Array(3), Uint32Array.of(0, 1, 4e9),
        new Uint8Array(200), () => 1, Symbol("s"), 10n, positions, indices, rays(5, 1), new Int32Array(9), true,
    ];
    const some = () => odd[below(odd.length)];
    const settings = () => {
        const names = ["preset", "layout", "maxMemory", "accuracy", "culling", "ignore", "into", "progress", "signal", "mask", "tMin", "maxDistance"];
        if (below(3) === 0) return some();
        return Object.fromEntries(names.filter(() => below(4) === 0).map((name) => [name, some()]));
    };
    const tree = make();
    const scene = new Scene();
    const calls = [
        () => Tree.build(some(), some(), settings()).free(),
        () => Tree.load(some(), some(), some(), settings()).free(),
        () => tree.closestHits(some(), settings()),
        () => tree.anyHits(some(), settings()),
        () => tree.allHits(some(), settings()),
        () => tree.windings(some(), settings()),
        () => tree.contains(some(), settings()),
        () => tree.closestPoints(some(), settings()),
        () => tree.closestHit(some(), some(), settings()),
        () => tree.anyHit(some(), some(), settings()),
        () => tree.toBytes(some(), some()),
        () => scene.addGeometry(some(), some()),
        () => scene.removeGeometry(some()),
        () => scene.addInstance(some(), some(), settings()),
        () => scene.moveInstance(some(), some()),
        () => scene.removeInstance(some()),
        () => scene.update(settings()),
        () => scene.closestHits(some(), settings()),
        () => scene.anyHits(some(), settings()),
        () => new WasmArray(some()).free(),
    ];
    let [ended, refused] = [0, 0];
    const before = tree.digest;
    for (let i = 0; i < 2000; i += 1) {
        try {
            calls[i % calls.length]();
            ended += 1;
        } catch (error) {
            assert.ok(error instanceof SplitplaneError, `call ${i % calls.length}: ${error.stack}`);
            assert.notEqual(error.code, "crashed", error.stack);
            refused += 1;
        }
    }
    assert.ok(ended > 20 && refused > 500, `${ended} ended well, ${refused} were refused`);
    assert.equal(tree.digest, before);
    assert.deepEqual(make().closestHits(rays(100, 1)), tree.closestHits(rays(100, 1)));
});
