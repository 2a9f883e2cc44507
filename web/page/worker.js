// The work: scenes, trees and pictures, away from the page so that it stays alive.

import { loadPart } from "./part.js";

/** Bytes of a file that are read at a time. */
const SLICE = 1 << 22;
/** Sides of the squares that a pixel of each picture fills, until the last one. */
const SQUARES = [8, 4, 2, 1];
/** A picture that takes longer than this is not begun with, in milliseconds. */
const AT_ONCE = 60;
/** Seconds that the GPU, or its driver, may take for one thing: software takes minutes for shaders on a busy machine, and who asks for it may wait. */
const PATIENCE = 300;
const [WATERTIGHT, EXACT] = [1, 2];

/**
 * The compiled part, its memory, and the most bytes that this can have. Only the part of one thread has WebGPU: the page asks for it by the name of
 * this worker.
 */
let raw = null;
let memory = null;
let mostMemory = 0;
let page = null;
/** What is to be shown; `null` when nothing is, or all is shown. */
let wanted = null;
let isDrawing = false;
/** Milliseconds a pixel of the picture before, by who made it. */
let pace = { cpu: null, gpu: null };
/**
 * Whether trees are built on the GPU too; the device, once it is opened; what ends a build there; whether the scene is there; why there is none.
 */
const gpu = { isOn: false, device: null, ends: null, isReady: false, why: null };
/** A promise while something is timed: pictures wait for it. */
let timing = null;
/** What was asked for while its file is being read. */
let opening = null;
/** The preset of the CPU's tree, which the GPU's has to have, too. */
let builtBy = null;
/** Counts what is wanted, so that work in the background sees that it is out of date. */
let turn = 0;

/** The number of the page's last choice of a scene or tree: what is told of an earlier one is out of date. */
let choice = 0;

const tell = (kind, told, transfer = []) => postMessage({ kind, choice, ...told }, transfer);

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

/** A picture's numbers, as the compiled part takes them. */
const numbers = (job, width, height, samples) =>
    Uint32Array.of(width, height, samples, job.depth, job.accuracy, Number(job.lights), job.view, job.light);

/** Why the CPU makes a picture that the GPU was asked for; `null` where the GPU does. */
function withoutGpu(job) {
    if (job.by !== "gpu") return "";
    if (gpu.why !== null) return gpu.why;
    if (!gpu.isReady) return "the scene is not on the GPU yet";
    if (job.accuracy === EXACT && gpu.device.parity() !== "bitwise") return "exact pictures take a GPU that passes its self-test bit for bit";
    if (job.light !== 0 && job.view === 0) return "the GPU makes pictures of direct light only";
    return null;
}

/** Makes a picture, on the GPU where it can: how long it took, and counts. `null` where its scene has gone meanwhile. */
async function frame(job, width, height, samples) {
    const own = page;
    const asked = numbers(job, width, height, samples);
    const since = performance.now();
    const why = withoutGpu(job);
    let told = null;
    if (why === null) {
        try {
            told = await own.frameOnGpu(asked);
        } catch (error) {
            if (isTrap(error)) throw error;
            if (own !== page) return null;
            leaveGpu(error.message ?? String(error));
        }
    }
    if (own !== page) {
        told?.free();
        return null;
    }
    const by = told === null ? "cpu" : "gpu";
    told ??= own.frame(asked);
    const took = performance.now() - since;
    const counts = { paths: told.paths, shadows: told.shadows, top: told.top };
    told.free();
    return { took, by, why: by === "gpu" ? null : (gpu.why ?? why), ...counts };
}

/** The pictures that lead to what is wanted: coarse ones, then more samples. */
function stepsOf(job) {
    const steps = SQUARES.map((square) => ({ square, samples: 1 }));
    const more = [4, job.samples].filter((samples, place) => samples > 1 && (place === 1 || samples < job.samples));
    if (job.view === 0) for (const samples of more) steps.push({ square: 1, samples });
    const own = pace[withoutGpu(job) === null ? "gpu" : "cpu"];
    const tooLong = ({ square }) => own === null || (own * job.width * job.height) / square ** 2 > AT_ONCE;
    // The finest of the first pictures that comes at once.
    while (steps.length > 1 && steps[1].samples === 1 && !tooLong(steps[1])) steps.shift();
    return steps;
}

async function draw() {
    if (isDrawing) return;
    isDrawing = true;
    try {
        while (wanted !== null && page !== null) {
            const job = wanted;
            const steps = stepsOf(job);
            for (const { square, samples } of steps) {
                await timing;
                if (wanted !== job || page === null) break;
                const [own, of] = [page, choice];
                const [width, height] = [job.width, job.height].map((side) => Math.max(1, Math.ceil(side / square)));
                const made = await frame(job, width, height, samples);
                // Another scene or tree has come while the GPU worked.
                if (made === null || of !== choice || own !== page) break;
                const { took, by, why, paths, shadows, top } = made;
                pace[by] = took / (width * height * samples);
                const pixels = new Uint8ClampedArray(memory.buffer, page.pixels(), 4 * page.count()).slice();
                const edges = job.boxes === null ? null : page.boxes(job.boxes, job.width, job.height);
                const isLast = square === 1 && samples === steps.at(-1).samples;
                const told = { width, height, samples, pixels: pixels.buffer, edges, took, by, why, paths, shadows, top, isLast, job };
                tell("picture", told, [pixels.buffer, ...(edges === null ? [] : [edges.buffer])]);
                await pause();
                if (wanted !== job) break;
            }
            if (wanted === job) {
                wanted = null;
                if (job.judges) await judge(job);
            }
        }
    } finally {
        isDrawing = false;
    }
}

/** What each accuracy takes here, and how far it is from the exact one; another wish ends it. */
async function judge(job) {
    const own = turn;
    const rows = [];
    for (const accuracy of [EXACT, WATERTIGHT, 0]) {
        await pause();
        if (own !== turn || page === null) return;
        const [took, [rays, other, lost]] = timed(() => page.judge(job.width, job.height, accuracy));
        rows.push({ accuracy, took, rays, other, lost });
    }
    tell("judged", { rows });
}

/** How long it took, and what came of it. */
function timed(work) {
    const since = performance.now();
    const done = work();
    return [performance.now() - since, done];
}

/** The bytes of the file that is to be opened, in the compiled part's memory; `null` for a built-in scene, or where something else was chosen meanwhile. */
async function read(message) {
    const { file, name } = message;
    if (file === undefined) return null;
    const words = new raw.Words(Math.ceil(file.size / 4));
    try {
        for (let at = 0; at < file.size; at += SLICE) {
            const slice = await file.slice(at, at + SLICE).arrayBuffer();
            if (opening !== message) break;
            // The memory may have grown meanwhile.
            new Uint8Array(memory.buffer, words.pointer() + at, slice.byteLength).set(new Uint8Array(slice));
        }
    } catch (error) {
        words.free();
        throw isTrap(error) ? error : new Error(`${name} cannot be read: ${error.message}`);
    }
    return words;
}

function open({ builtin, file, name }, words) {
    if (words === null) return raw.Page.builtin(builtin);
    try {
        return raw.Page.read(words, file.size, name);
    } finally {
        words.free();
    }
}

function build(preset, aspect) {
    let told = 0;
    builtBy = preset;
    const [took] = timed(() =>
        page.build(preset, aspect, (stage, done, total) => {
            const now = performance.now();
            if (now - told < 100) return;
            told = now;
            tell("progress", { stage, done, total });
        }),
    );
    const [nodes, references, bytes, deepest] = page.size();
    tell("built", { preset, took, digest: page.digest(), nodes, references, bytes, deepest });
}

/** The scene leaves the GPU, and the CPU goes on: `why` is told. */
function leaveGpu(why) {
    gpu.isReady = false;
    gpu.why = why;
    tell("gpu", { state: "failed", text: why });
}

/** A device may go away while nothing is asked of it, as when the browser's GPU process ends. */
function lookAfterGpu() {
    const why = gpu.isReady && !isDrawing && timing === null ? gpu.device.lost() : undefined;
    if (why !== undefined) leaveGpu(why);
}

/** Opens the GPU, where it is not open; the one that was lost is left. */
async function openGpu() {
    if (gpu.device !== null && !gpu.device.lost()) return;
    tell("gpu", { state: "opening" });
    gpu.device?.free();
    gpu.device = null;
    if (!navigator.gpu) throw new Error("this browser has no WebGPU here");
    const device = await raw.Gpu.open(PATIENCE, false);
    if (gpu.device === null) gpu.device = device;
    else device.free();
}

/** Builds the tree of the scene on the GPU, twice: the first time takes compiling along. */
async function buildOnGpu() {
    gpu.ends?.abort();
    gpu.isReady = false;
    gpu.why = null;
    if (!gpu.isOn || page === null) return page?.leaveGpu?.();
    page.leaveGpu();
    gpu.ends = new AbortController();
    const { signal } = gpu.ends;
    const own = page;
    let done = () => {};
    try {
        await openGpu();
        if (signal.aborted || own !== page) return;
        const { device } = gpu;
        const about = { adapter: device.adapter() || "a GPU that the browser does not name", isSoftware: device.isSoftware(), parity: device.parity(), difference: device.difference() };
        tell("gpu", { state: "building", ...about });
        timing = new Promise((resolve) => (done = resolve));
        const times = [];
        let digest = null;
        for (let round = 0; round < 2; round += 1) {
            const since = performance.now();
            digest = await own.buildOnGpu(device, builtBy, () => signal.aborted);
            times.push(performance.now() - since);
            if (signal.aborted || own !== page) return;
        }
        [gpu.isReady, gpu.why] = [true, null];
        tell("gpu", { state: "built", ...about, first: times[0], took: times[1], digest });
    } catch (error) {
        if (isTrap(error)) throw error;
        // Another scene, or another choice, has come meanwhile.
        if (error.code !== "cancelled" && own === page) leaveGpu(error.message ?? String(error));
    } finally {
        done();
        if (gpu.ends?.signal === signal) timing = null;
    }
}

/**
 * Each accuracy, alternately; the median of three. And where the scene is on a GPU, its rays against the CPU's. Nothing is told where another scene
 * or tree has come meanwhile.
 */
async function measure(job) {
    const [own, of] = [page, choice];
    const isOver = () => own !== page || of !== choice;
    const rows = [0, WATERTIGHT, EXACT].map((accuracy) => ({ accuracy, times: [], rays: 0 }));
    for (let round = 0; round < 3; round += 1) {
        for (const row of rows) {
            const asked = { ...job, accuracy: row.accuracy, view: 0, light: 0, by: "cpu" };
            const made = await frame(asked, job.width, job.height, 1);
            if (made === null || isOver()) return;
            row.times.push(made.took);
            row.rays = made.paths + made.shadows;
        }
    }
    const median = (times) => times.toSorted((a, b) => a - b)[1];
    const frames = rows.map(({ accuracy, times, rays }) => ({ accuracy, took: median(times), rays }));
    let onGpu = null;
    if (gpu.isReady) {
        const asked = numbers({ ...job, accuracy: WATERTIGHT, view: 0, light: 0 }, job.width, job.height, 1);
        const pixels = () => new Uint32Array(memory.buffer, own.pixels(), own.count()).slice();
        try {
            const [rays, differ] = await own.compareWithGpu(job.width, job.height);
            if (isOver()) return;
            own.frame(asked).free();
            const wanted = pixels();
            const since = performance.now();
            (await own.frameOnGpu(asked)).free();
            if (isOver()) return;
            const took = performance.now() - since;
            const found = pixels();
            const pixelsDiffer = wanted.reduce((count, pixel, place) => count + Number(pixel !== found[place]), 0);
            onGpu = { rays, differ, pixels: wanted.length, pixelsDiffer, took };
        } catch (error) {
            if (isTrap(error)) throw error;
            if (isOver()) return;
            leaveGpu(error.message ?? String(error));
        }
    }
    tell("measured", { width: job.width, height: job.height, frames, onGpu });
}

const does = {
    gpu({ isOn }) {
        gpu.isOn = isOn;
        return buildOnGpu();
    },
    async open(message) {
        choice = message.choice;
        gpu.ends?.abort();
        [wanted, turn] = [null, turn + 1];
        gpu.isReady = false;
        // Its memory is for the next one.
        page?.free();
        page = null;
        opening = message;
        let words = null;
        try {
            words = await read(message);
        } catch (error) {
            if (isTrap(error) || opening === message) throw error;
        }
        // Something else was chosen while the file was read.
        if (opening !== message) return words?.free();
        opening = null;
        const [took, opened] = timed(() => open(message, words));
        page = opened;
        pace = { cpu: null, gpu: null };
        tell("opened", { name: message.name, took, triangles: page.triangles(), notes: page.notes() });
        build(message.preset, message.aspect);
        await buildOnGpu();
    },
    build(message) {
        const { preset, aspect } = message;
        choice = message.choice;
        if (opening !== null) opening.preset = preset;
        if (page === null) return;
        [wanted, turn] = [null, turn + 1];
        build(preset, aspect);
        return buildOnGpu();
    },
    move({ right = 0, down = 0, steps = 0, home = false }) {
        if (page === null) return;
        if (home) page.home();
        if (right !== 0 || down !== 0) page.turn(right, down);
        if (steps !== 0) page.zoom(steps);
    },
    draw({ job }) {
        [wanted, turn] = [job, turn + 1];
        return draw();
    },
    async measure({ job }) {
        if (page === null) return;
        [wanted, turn] = [null, turn + 1];
        const of = choice;
        // A picture that the GPU has begun comes first, and what is timed there.
        while (isDrawing || timing !== null) await new Promise((resume) => setTimeout(resume, 5));
        if (page === null || of !== choice) return;
        let done;
        const own = new Promise((resolve) => (done = resolve));
        timing = own;
        try {
            await measure(job);
        } finally {
            done();
            if (timing === own) timing = null;
        }
    },
};

/** Whether the compiled part has ended: its memory is not to be trusted, and the page starts another worker. */
function isTrap(error) {
    return error instanceof WebAssembly.RuntimeError || error instanceof RangeError;
}

/** Whether the page was told so: each thread that traps comes here, and the page starts one new worker. */
let isOver = false;

function end(error) {
    if (isOver) return;
    isOver = true;
    // Much memory is most often why.
    const held = memory?.buffer.byteLength ?? 0;
    const [some, most] = [held, mostMemory].map((bytes) => Math.round(bytes / 2 ** 20).toLocaleString("en"));
    const much = held > mostMemory / 4 ? ` when it had ${some} MiB of memory, of ${most} at most` : "";
    tell("failed", { text: `The compiled part has ended${much} (${error.message ?? error}).`, isDead: true });
}

// A trap in the middle of a promise is told to nobody else.
addEventListener("unhandledrejection", ({ reason }) => end(reason));

setInterval(() => {
    try {
        lookAfterGpu();
    } catch (error) {
        end(error);
    }
}, 1000);

onmessage = async ({ data }) => {
    try {
        await does[data.do](data);
    } catch (error) {
        if (isTrap(error)) end(error);
        else tell("failed", { text: error.message ?? String(error), isDead: false, ...(data.choice === undefined ? {} : { choice: data.choice }) });
    }
};

try {
    const part = await loadPart(location.search === "?gpu", (text) => end({ message: `a thread: ${text}` }));
    ({ raw, memory, mostMemory } = part);
    raw.afterCrash?.((message) => end({ message }));
    const scenes = raw.Page.builtinScenes();
    const named = scenes.filter((_, place) => place % 2 === 0).map((name, place) => ({ name, shows: scenes[2 * place + 1] }));
    tell("ready", { scenes: named, mostBytes: raw.Page.mostBytes(), mostBoxes: raw.Page.mostBoxes(), version: raw.version(), instructionSet: raw.instructionSet(), threads: part.threads, whyOne: part.why });
} catch (error) {
    tell("failed", { text: `the compiled part cannot be loaded: ${error.message ?? error}`, isDead: false });
}
