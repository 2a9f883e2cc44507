// What tests/webgpu.mjs runs in a page: the package on the browser's GPU. Numbers are compared there with native ones.

import * as api from "/js/index.js";
import { allLine, instancesAsync } from "./answers.mjs";
import { Hash, bits, noise, rays, sphere } from "./meshes.mjs";

const MESHES = { web_sphere: [sphere(24), 1], web_noise: [noise(4000), 4] };

/** The browser's device, of which the package gives no more than it must. */
let device = null;
const { requestDevice } = GPUAdapter.prototype;
GPUAdapter.prototype.requestDevice = async function (...all) {
    device = await requestDevice.apply(this, all);
    return device;
};

/** How long the event loop was held up at most since it was begun, in milliseconds. */
function gaps() {
    let [last, longest] = [performance.now(), 0];
    const timer = setInterval(() => {
        const now = performance.now();
        [longest, last] = [Math.max(longest, now - last), now];
    }, 5);
    return () => {
        clearInterval(timer);
        return longest;
    };
}

function* records(columns) {
    const words = columns.map((column) => (column instanceof Float32Array ? bits(column) : column));
    for (let i = 0; i < words[0].length; i += 1) for (const column of words) yield column[i];
}

/** What an error is, for the outside. */
async function failure(work) {
    try {
        await work();
        return null;
    } catch (error) {
        return { isOurs: error instanceof api.SplitplaneError, code: error.code, message: error.message, cause: error.cause ?? null };
    }
}

let backend = null;
let gpu = null;

/** Opens the GPU. Most of the time is the self-test's, whose shaders SwiftShader compiles. */
export async function open() {
    await api.init();
    const since = performance.now();
    backend = await api.Backend.open("gpu", { timeout: 900 });
    gpu = backend.gpu;
    const { adapter, isSoftware, parity, difference, lost } = gpu;
    return { adapter, isSoftware, parity, difference, lost, milliseconds: performance.now() - since };
}

/** Digests and hits, in the words of the snapshots; and the longest time without an event. */
export async function answers(name, presets) {
    const [{ positions, indices }, scale] = MESHES[name];
    const longest = gaps();
    const lines = [];
    for (const preset of presets) {
        const tree = await gpu.build(positions, indices, { preset });
        lines.push(`digest ${preset}: ${tree.digest}`);
        if (preset === "fast") {
            const bytes = tree.toBytes(positions, indices);
            lines.push(`file: ${bytes.length} ${Hash.of(bytes)}`);
            const asked = rays(3000, scale);
            for (const culling of ["none", "back", "front"]) {
                const { t, triangle, u, v } = await tree.closestHitsAsync(asked, { culling });
                const found = triangle.filter((number) => number !== api.NONE).length;
                lines.push(`closest watertight ${culling}: ${found} ${Hash.of(records([t, triangle, u, v]))}`);
                lines.push(`any watertight ${culling}: ${Hash.of(await tree.anyHitsAsync(asked, { culling }))}`);
            }
            lines.push(allLine(await tree.allHitsAsync(asked)));
            // Into an array of the module's, from one: the same words.
            const [from, into] = [new api.WasmArray(asked.length), new api.WasmArray(asked.length / 2)];
            from.floats.set(asked);
            await tree.closestHitsAsync(from, { into });
            const cpu = api.Tree.build(positions, indices);
            const expected = new api.WasmArray(asked.length / 2);
            cpu.closestHits(from, { into: expected });
            if (Hash.of(into.words) !== Hash.of(expected.words)) lines.push("words differ from the CPU's");
            for (const one of [cpu, from, into, expected]) one.free();
        }
        tree.free();
    }
    return { lines, longest: longest() };
}

/** A scene of instances: lines of the snapshots; and what is refused. */
export async function objects() {
    const scene = backend.scene();
    const found = { stale: await failure(() => scene.digest), early: await failure(() => scene.closestHitsAsync(rays(2, 1))) };
    const lines = await instancesAsync(scene);
    found.exact = await failure(() => scene.anyHitsAsync(rays(2, 1), { accuracy: "exact" }));
    found.unknown = await failure(() => scene.addInstance(9, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]));
    const update = scene.updateAsync();
    found.busy = await failure(() => scene.removeInstance(0));
    await update;
    const batch = scene.anyHitsAsync(rays(500, 4));
    found.under = await failure(() => scene.updateAsync());
    await batch;
    found.ended = await failure(() => scene.anyHitsAsync(rays(500, 4), { progress: () => false }));
    scene.removeInstance(0);
    found.edited = await failure(() => scene.anyHitsAsync(rays(2, 1)));
    await scene.updateAsync();
    const other = scene.digest;
    scene.free();
    found.freed = await failure(() => scene.digest);
    return { lines, found, isOther: !lines.includes(`digest: ${other}`) };
}

/** Two builds and two batches at once, from one page. */
export async function together() {
    const [{ positions, indices }, scale] = MESHES.web_noise;
    const [{ positions: other, indices: corners }] = MESHES.web_sphere;
    const [one, two] = await Promise.all([gpu.build(positions, indices), gpu.build(other, corners)]);
    const asked = rays(2000, scale);
    const [first, second] = await Promise.all([one.closestHitsAsync(asked), one.anyHitsAsync(asked)]);
    const isSame = first.triangle.every((triangle, ray) => (triangle !== api.NONE) === (second[ray] === 1));
    const digests = [one.digest, two.digest];
    one.free();
    two.free();
    return { digests, isSame };
}

/** Work that is ended, and misuse: errors, and the GPU goes on. */
export async function ended() {
    const [{ positions, indices }] = MESHES.web_noise;
    const controller = new AbortController();
    const build = gpu.build(positions, indices, { signal: controller.signal });
    controller.abort("enough");
    const found = { abort: await failure(() => build) };
    found.progress = await failure(() => gpu.build(positions, indices, { progress: () => false }));
    found.thrown = await failure(() => gpu.build(positions, indices, { progress: () => { throw new RangeError("own"); } }));
    found.before = await failure(() => gpu.build(positions, indices, { signal: AbortSignal.abort("no") }));
    found.best = await failure(() => gpu.build(positions, indices, { preset: "best" }));
    found.type = await failure(() => gpu.build([1, 2, 3]));
    found.shape = await failure(() => gpu.build(new Float32Array(10), indices));
    found.mesh = await failure(() => gpu.build(positions, Uint32Array.of(0, 1, 99_999)));
    found.memory = await failure(() => gpu.build(positions, indices, { maxMemory: 1000 }));
    const tree = await gpu.build(positions, indices);
    found.rays = await failure(() => tree.closestHitsAsync(new Float32Array(9)));
    found.accuracy = await failure(() => tree.closestHitsAsync(new Float32Array(8), { accuracy: "best" }));
    found.batch = await failure(() => tree.anyHitsAsync(rays(3000, 4), { progress: () => false }));
    found.digest = tree.digest;
    const empty = await gpu.build(new Float32Array(0));
    found.empty = (await empty.closestHitsAsync(rays(3, 1))).triangle.every((triangle) => triangle === api.NONE);
    for (const one of [tree, empty]) one.free();
    found.freed = await failure(() => tree.anyHitsAsync(new Float32Array(8)));
    return found;
}

/** One choice: `auto` passes over software; both kinds of trees answer alike. */
export async function choice() {
    const [{ positions, indices }, scale] = MESHES.web_sphere;
    const found = [];
    for (const one of [await api.Backend.open("auto", { timeout: 900 }), await api.Backend.open("cpu"), backend]) {
        const tree = await one.build(positions, indices);
        const { t } = await tree.closestHitsAsync(rays(500, scale));
        found.push({ name: one.name, reason: one.reason, digest: tree.digest, hits: Hash.of(bits(t)) });
        tree.free();
        if (one !== backend) one.free();
    }
    return found;
}

/** What is under way while the browser's GPU process ends, by `crashed`. */
let ending = null;

/** Begins a build, a batch, a scene's update, and the opening of another GPU. */
export async function underWay() {
    const [{ positions, indices }, scale] = MESHES.web_noise;
    const tree = await gpu.build(positions, indices);
    const scene = gpu.scene();
    scene.addInstance(scene.addGeometry(positions, indices), [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]);
    const asked = rays(20_000, scale);
    const work = {
        build: () => gpu.build(positions, indices),
        closest: () => tree.closestHitsAsync(asked),
        all: () => tree.allHitsAsync(asked),
        update: () => scene.updateAsync(),
        open: () => api.Gpu.open({ timeout: 900 }),
    };
    ending = { tree, scene, work: Object.entries(work).map(async ([name, work]) => [name, await failure(work)]) };
}

/** How that ended; then a GPU is opened again, and answers. */
export async function crashed() {
    const [{ positions, indices }, scale] = MESHES.web_noise;
    const { tree, scene, work } = ending;
    const found = { during: Object.fromEntries(await Promise.all(work)) };
    const asked = rays(500, scale);
    found.query = await failure(() => tree.anyHitsAsync(asked));
    found.update = await failure(() => scene.updateAsync());
    found.lost = gpu.lost;
    const cpu = api.Tree.load(tree.toBytes(positions, indices), positions, indices);
    const before = Hash.of(bits(cpu.closestHits(asked).t));
    for (const one of [tree, scene, cpu, backend]) one.free();
    backend = await api.Backend.open("gpu", { timeout: 900 });
    gpu = backend.gpu;
    const again = await gpu.build(positions, indices);
    found.again = { parity: gpu.parity, digest: again.digest, isSame: Hash.of(bits((await again.closestHitsAsync(asked)).t)) === before };
    again.free();
    return found;
}

/** The device goes away in the middle of work: errors, and the CPU goes on. */
export async function lost() {
    const [{ positions, indices }, scale] = MESHES.web_noise;
    const own = gpu;
    const tree = await own.build(positions, indices);
    const asked = rays(1000, scale);
    const before = await tree.closestHitsAsync(asked);
    const under = [own.build(positions, indices), tree.closestHitsAsync(asked)].map((work) => failure(() => work));
    device.destroy();
    const found = { during: await Promise.all(under) };
    found.query = await failure(() => tree.closestHitsAsync(asked));
    found.build = await failure(() => own.build(positions, indices));
    found.lost = own.lost;
    const cpu = api.Tree.load(tree.toBytes(positions, indices), positions, indices);
    const after = await cpu.closestHitsAsync(asked);
    found.isSame = cpu.digest === tree.digest && Hash.of(bits(after.t)) === Hash.of(bits(before.t));
    for (const one of [cpu, tree, own]) one.free();
    found.freed = await failure(() => own.build(positions, indices));
    return found;
}
