// The work: scenes, trees and pictures, away from the page so that it stays alive.

import { Gpu } from "./js/gpu.js";
import { start } from "./js/module.js";
import load, * as raw from "./pkg/splitplane.js";

/** Sides of the squares that a pixel of each picture fills, until the last one. */
const SQUARES = [8, 4, 2, 1];
/** A picture that takes longer than this is not begun with, in milliseconds. */
const AT_ONCE = 60;

let memory = null;
let page = null;
/** What is to be shown; `null` when nothing is, or all is shown. */
let wanted = null;
let isDrawing = false;
/** Whether trees are built on the GPU too; the device, once it is opened; what ends a build there. */
const gpu = { isOn: false, device: null, ends: null };
/** A promise while a build on the GPU is timed: pictures wait for it. */
let timing = null;
/** Milliseconds a pixel of the picture before. */
let pace = null;

const tell = (kind, told, transfer = []) => postMessage({ kind, ...told }, transfer);

/** The event loop, and with it what the page wants by now. */
function pause() {
    return new Promise((resume) => {
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => {
            port1.close();
            resume();
        };
        port2.postMessage(0);
    });
}

function frame(width, height, samples) {
    const { depth, accuracy, lights, view } = wanted;
    const since = performance.now();
    const told = page.frame(width, height, samples, depth, accuracy, lights, view);
    const took = performance.now() - since;
    const counts = { paths: told.paths, shadows: told.shadows, top: told.top };
    told.free();
    return { took, ...counts };
}

async function draw() {
    if (isDrawing) return;
    isDrawing = true;
    try {
        while (wanted !== null && page !== null) {
            const job = wanted;
            const steps = SQUARES.map((square) => ({ square, samples: 1 }));
            const more = [4, job.samples].filter((samples, place) => samples > 1 && (place === 1 || samples < job.samples));
            if (job.view === 0) for (const samples of more) steps.push({ square: 1, samples });
            const tooLong = ({ square }) => pace === null || (pace * job.width * job.height) / square ** 2 > AT_ONCE;
            // The finest of the first pictures that comes at once.
            while (steps.length > 1 && steps[1].samples === 1 && !tooLong(steps[1])) steps.shift();
            for (const { square, samples } of steps) {
                const [width, height] = [job.width, job.height].map((side) => Math.max(1, Math.ceil(side / square)));
                const { took, paths, shadows, top } = frame(width, height, samples);
                pace = took / (width * height * samples);
                const pixels = new Uint8ClampedArray(memory.buffer, page.pixels(), 4 * page.count()).slice();
                const isLast = square === 1 && samples === steps.at(-1).samples;
                tell("picture", { width, height, samples, pixels: pixels.buffer, took, paths, shadows, top, isLast, job }, [pixels.buffer]);
                await pause();
                await timing;
                if (wanted !== job) break;
            }
            if (wanted === job) wanted = null;
        }
    } finally {
        isDrawing = false;
    }
}

/** How long it took, and what came of it. */
function timed(work) {
    const since = performance.now();
    const done = work();
    return [performance.now() - since, done];
}

function open({ builtin, file, name }) {
    page?.free();
    page = null;
    if (builtin !== undefined) return raw.Page.builtin(builtin);
    const words = new raw.Words(Math.ceil(file.byteLength / 4));
    try {
        new Uint8Array(memory.buffer, words.pointer(), file.byteLength).set(new Uint8Array(file));
        return raw.Page.read(words, file.byteLength, name);
    } finally {
        words.free();
    }
}

function build(preset, aspect) {
    let told = 0;
    const [took] = timed(() =>
        page.build(preset, aspect, (stage, done, total) => {
            const now = performance.now();
            if (now - told < 100) return;
            told = now;
            tell("progress", { stage, done, total });
        }),
    );
    const [nodes, references, bytes] = page.size();
    tell("built", { preset, took, digest: page.digest(), nodes, references, bytes });
}

/** A tree on the GPU, and how long it took. */
async function timedOnGpu(...all) {
    const since = performance.now();
    const tree = await gpu.device.build(...all);
    const took = performance.now() - since;
    const { digest } = tree;
    tree.free();
    return { took, digest };
}

/** Builds the tree of the scene on the GPU, twice: the first time takes compiling along. */
async function buildOnGpu(preset) {
    gpu.ends?.abort();
    if (!gpu.isOn || page === null) return;
    gpu.ends = new AbortController();
    const { signal } = gpu.ends;
    const own = page;
    let done = () => {};
    try {
        if (gpu.device === null || gpu.device.lost !== null) {
            tell("gpu", { state: "opening" });
            gpu.device?.free();
            gpu.device = null;
            // Software takes minutes for the shaders on a busy machine, and who asked for it here may wait.
            const device = await Gpu.open({ signal, timeout: 300 });
            if (gpu.device === null) gpu.device = device;
            else device.free();
        }
        if (signal.aborted || own !== page) return;
        const { adapter, isSoftware, parity, difference } = gpu.device;
        tell("gpu", { state: "building", adapter, isSoftware, parity, difference });
        const [positions, indices] = [page.positions(), page.indices()];
        const copied = (words, type) => new type(memory.buffer, words.pointer(), words.length()).slice();
        const mesh = [copied(positions, Float32Array), copied(indices, Uint32Array)];
        positions.free();
        indices.free();
        timing = new Promise((resolve) => (done = resolve));
        const first = await timedOnGpu(...mesh, { preset, signal });
        const { took, digest } = await timedOnGpu(...mesh, { preset, signal });
        tell("gpu", { state: "built", adapter, isSoftware, parity, difference, first: first.took, took, digest });
    } catch (error) {
        // Another scene, or another choice, has come meanwhile.
        if (error.code !== "cancelled") tell("gpu", { state: "failed", text: error.message ?? String(error) });
    } finally {
        done();
        if (gpu.ends?.signal === signal) timing = null;
    }
}

const does = {
    gpu({ isOn, preset }) {
        gpu.isOn = isOn;
        return buildOnGpu(preset);
    },
    open(message) {
        gpu.ends?.abort();
        wanted = null;
        const [took, opened] = timed(() => open(message));
        page = opened;
        pace = null;
        tell("opened", { name: message.name, took, triangles: page.triangles(), notes: page.notes() });
        build(message.preset, message.aspect);
        return buildOnGpu(message.preset);
    },
    build({ preset, aspect }) {
        if (page === null) return;
        wanted = null;
        build(preset, aspect);
        return buildOnGpu(preset);
    },
    move({ right = 0, down = 0, steps = 0, home = false }) {
        if (page === null) return;
        if (home) page.home();
        if (right !== 0 || down !== 0) page.turn(right, down);
        if (steps !== 0) page.zoom(steps);
    },
    draw({ job }) {
        wanted = job;
        return draw();
    },
    /** Each accuracy, alternately; the median of three. */
    measure({ job }) {
        if (page === null) return;
        wanted = null;
        const rows = [0, 1, 2].map((accuracy) => ({ accuracy, times: [], rays: 0 }));
        for (let round = 0; round < 3; round += 1) {
            for (const row of rows) {
                wanted = { ...job, accuracy: row.accuracy, view: 0 };
                const { took, paths, shadows } = frame(job.width, job.height, 1);
                row.times.push(took);
                row.rays = paths + shadows;
            }
        }
        wanted = null;
        const median = (times) => times.toSorted((a, b) => a - b)[1];
        tell("measured", { width: job.width, height: job.height, rows: rows.map(({ accuracy, times, rays }) => ({ accuracy, took: median(times), rays })) });
    },
};

onmessage = async ({ data }) => {
    try {
        await does[data.do](data);
    } catch (error) {
        // After a trap the module's memory is not to be trusted: the page starts another worker.
        tell("failed", { text: error.message ?? String(error), isDead: error instanceof WebAssembly.RuntimeError || error instanceof RangeError });
    }
};

try {
    ({ memory } = await load());
    await start();
    const scenes = raw.Page.builtinScenes();
    const named = scenes.filter((_, place) => place % 2 === 0).map((name, place) => ({ name, shows: scenes[2 * place + 1] }));
    tell("ready", { scenes: named, mostBytes: raw.Page.mostBytes(), version: raw.version(), instructionSet: raw.instructionSet() });
} catch (error) {
    tell("failed", { text: `the compiled part cannot be loaded: ${error.message ?? error}`, isDead: false });
}
