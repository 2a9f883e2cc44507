// WebGPU: devices, and trees on them. Its compiled part, with memory of its own, is loaded when it is first asked for.

import { CULLINGS, NONE, queryOptions, room } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { call, hasCrashed, movedAll, part, settled } from "./gpu-module.js";
import { GpuScene } from "./gpu-scene.js";
import { buildOptions, limit, meshArrays } from "./mesh.js";
import { choice, count, number, options, watcher } from "./module.js";
import { allFound, column } from "./queries.js";
import { SUMMARY } from "./tree.js";

/** Seconds that a device may take for one thing, if nobody says more: a page should not wait longer. */
const TIMEOUT = 60;
const RAYS = { what: "rays", type: Float32Array, each: 8 };

/** A tree on a GPU; see index.d.ts. */
export class GpuTree {
    #own;
    #part;

    constructor(own, loaded) {
        if (loaded === undefined || !(own instanceof loaded.raw.GpuTree)) throw new SplitplaneError("type", "a GpuTree is made by Gpu.build");
        this.#own = own;
        this.#part = loaded;
    }

    #alive() {
        if (this.#own === null) throw new SplitplaneError("freed", "this GpuTree was freed");
        return this.#own;
    }

    get digest() {
        return call(() => this.#alive().digest());
    }

    get summary() {
        const numbers = call(() => this.#alive().summary());
        return Object.fromEntries(SUMMARY.map((name, place) => [name, numbers[place]]));
    }

    get bounds() {
        const corners = call(() => this.#alive().bounds());
        return { min: corners.slice(0, 3), max: corners.slice(3) };
    }

    toBytes(positions, indices) {
        const own = this.#alive();
        const { isIndexed, arrays } = meshArrays(positions, indices);
        const made = movedAll(this.#part, arrays);
        try {
            return call(() => own.toBytes(...made, isIndexed));
        } finally {
            if (!hasCrashed()) for (const words of made) words.free();
        }
    }

    /** Asks, and hands what comes back, as bytes, to `give`. */
    async #ask(name, rays, given, answerWords, give) {
        const own = this.#alive();
        const known = options(given);
        const { accuracy, culling, ignore, into } = queryOptions(known);
        const watch = watcher(known);
        watch.begin();
        const total = (rays?.length ?? 0) / 8;
        if (into !== undefined) room(into, rays, answerWords(total), "the answers");
        const [asked] = movedAll(this.#part, [{ ...RAYS, value: rays }]);
        const words = await watch.later(() => settled(() => own[name](asked, accuracy, culling, ignore, watch.called)));
        try {
            const found = new Uint32Array(this.#part.memory.buffer, words.pointer(), words.length());
            if (into === undefined) return give(found, total);
            into.words.set(found);
            return into;
        } finally {
            words.free();
        }
    }

    closestHitsAsync(rays, given) {
        return this.#ask("closestHits", rays, given, (total) => 4 * total, (words, total) => {
            const floats = new Float32Array(words.buffer, words.byteOffset, words.length);
            return {
                t: column(floats, total, 4, 0, Float32Array),
                triangle: column(words, total, 4, 1, Uint32Array),
                u: column(floats, total, 4, 2, Float32Array),
                v: column(floats, total, 4, 3, Float32Array),
            };
        });
    }

    anyHitsAsync(rays, given) {
        return this.#ask("anyHits", rays, given, (total) => Math.ceil(total / 4), (words, total) =>
            new Uint8Array(words.buffer, words.byteOffset, total).slice(),
        );
    }

    /** All crossings of rays with surfaces, in order; see index.d.ts. */
    async allHitsAsync(rays, given) {
        const own = this.#alive();
        const known = options(given);
        const side = choice(known.culling ?? "none", "culling", CULLINGS);
        const ignore = known.ignore === undefined || known.ignore === null ? NONE : count(known.ignore, "ignore");
        const most = limit(known.maxMemory);
        const watch = watcher(known);
        watch.begin();
        const [asked] = movedAll(this.#part, [{ ...RAYS, value: rays }]);
        const all = await watch.later(() => settled(() => own.allHits(asked, side, ignore, most, watch.called)));
        const parts = [all.starts(), all.crossings()];
        all.free();
        try {
            return allFound(...parts.map((words) => new Uint32Array(this.#part.memory.buffer, words.pointer(), words.length())));
        } finally {
            for (const words of parts) words.free();
        }
    }

    free() {
        if (this.#own !== null) {
            if (!hasCrashed()) this.#own.free();
            this.#own = null;
        }
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}

/** A browser's GPU; see index.d.ts. */
export class Gpu {
    #own;
    #part;

    constructor(own, loaded) {
        if (loaded === undefined || !(own instanceof loaded.raw.Gpu)) throw new SplitplaneError("type", "a Gpu is made by Gpu.open");
        this.#own = own;
        this.#part = loaded;
    }

    static async open(given) {
        const { timeout = TIMEOUT, source, hardware = false, signal } = options(given);
        if (!(number(timeout, "timeout") >= 0)) {
            throw new SplitplaneError("config", `timeout is ${timeout}, but must be 0 seconds or more`);
        }
        const watch = watcher({ signal });
        watch.begin();
        if (!globalThis.navigator?.gpu) {
            throw new SplitplaneError("no-webgpu", "there is no WebGPU here; pages have it from https and localhost only, and not in every browser");
        }
        const loaded = await part(source);
        watch.begin();
        const own = await settled(() => loaded.raw.Gpu.open(timeout, hardware === true));
        const gpu = new Gpu(own, loaded);
        if (signal?.aborted) {
            gpu.free();
            watch.begin();
        }
        return gpu;
    }

    #alive() {
        if (this.#own === null) throw new SplitplaneError("freed", "this Gpu was freed");
        return this.#own;
    }

    get adapter() {
        return call(() => this.#alive().adapter()) || "a GPU that the browser does not name";
    }

    get isSoftware() {
        return call(() => this.#alive().isSoftware());
    }

    get parity() {
        return call(() => this.#alive().parity());
    }

    get difference() {
        return call(() => this.#alive().difference()) ?? null;
    }

    get lost() {
        return call(() => this.#alive().lost()) ?? null;
    }

    scene() {
        return new GpuScene(call(() => this.#alive().scene()), this.#part);
    }

    async build(positions, indices, given) {
        const own = this.#alive();
        const known = options(given);
        const { isIndexed, arrays } = meshArrays(positions, indices);
        const [preset, , maxMemory] = buildOptions(known);
        const watch = watcher(known);
        watch.begin();
        const made = movedAll(this.#part, arrays);
        const work = () => settled(() => own.build(...made, isIndexed, preset, maxMemory, watch.called));
        return new GpuTree(await watch.later(work), this.#part);
    }

    free() {
        if (this.#own !== null) {
            if (!hasCrashed()) {
                this.#own.destroy();
                this.#own.free();
            }
            this.#own = null;
        }
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}
