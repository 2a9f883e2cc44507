import { CULLINGS, NONE, queryOptions } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { buildOptions, limit, meshArrays } from "./mesh.js";
import { Calls, WasmArray, call, choice, count, options, pause, raw, watcher, withArrays } from "./module.js";
import { allFound, any, closest, near, oneRay, windings } from "./queries.js";

export const SUMMARY = ["triangles", "dropped", "snapped", "peakBytes", "queryBytes", "nodes", "references"];

/** Builds by the compiled part's function `make`, which takes arrays of a mesh. */
function built(positions, indices, given, make) {
    const known = options(given);
    const { isIndexed, arrays } = meshArrays(positions, indices);
    const settings = buildOptions(known);
    const watch = watcher(known);
    return withArrays(arrays, (points, corners) =>
        watch.run(() => make(points.own, corners.own, isIndexed, ...settings, watch.called)),
    );
}

function refuseInto(given) {
    if (options(given).into !== undefined) throw new SplitplaneError("config", "contains has no `into`; windings has");
}

/** 1 for each point that the surface winds around, or that lies on it. */
function inside({ winding, boundary }) {
    const out = new Uint8Array(winding.length);
    for (let i = 0; i < out.length; i += 1) out[i] = Number(winding[i] !== 0 || boundary[i] !== 0);
    return out;
}

/** A tree over a mesh; see index.d.ts. */
export class Tree {
    #own;
    #calls = new Calls("Tree");
    #version = 0;

    /** Takes what the compiled part made; users call `Tree.build`. */
    constructor(own) {
        if (!(own instanceof raw.Tree)) throw new SplitplaneError("type", "a tree is made by Tree.build or Tree.load");
        this.#own = own;
    }

    static build(positions, indices, given) {
        return new Tree(built(positions, indices, given, (...all) => raw.Tree.build(...all)));
    }

    static async buildAsync(positions, indices, given) {
        await pause();
        const tree = Tree.build(positions, indices, given);
        await pause();
        if (options(given).signal?.aborted) {
            tree.free();
            throw new SplitplaneError("cancelled", "cancelled after the build", { cause: given.signal.reason });
        }
        return tree;
    }

    static load(bytes, positions, indices, given) {
        const known = options(given);
        const { isIndexed, arrays } = meshArrays(positions, indices);
        const [, layout, maxMemory] = buildOptions(known);
        const watch = watcher(known);
        const file = { value: bytes, what: "the file", type: Uint8Array, each: 1 };
        return withArrays([file, ...arrays], (kept, points, corners) => {
            const mesh = [points.own, corners.own, isIndexed];
            return new Tree(watch.run(() => raw.Tree.load(kept.own, bytes.length, ...mesh, layout, maxMemory, watch.called)));
        });
    }

    #alive() {
        if (this.#own === null) throw new SplitplaneError("freed", "this Tree was freed");
        this.#calls.ask();
        return this.#own;
    }

    rebuild(positions, indices, given) {
        const own = this.#alive();
        built(positions, indices, given, (...all) => {
            this.#version += 1;
            this.#calls.changing(() => own.rebuild(...all));
        });
    }

    toBytes(positions, indices) {
        const own = this.#alive();
        const { isIndexed, arrays } = meshArrays(positions, indices);
        return withArrays(arrays, (points, corners) => call(() => own.toBytes(points.own, corners.own, isIndexed)));
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

    closestHits(rays, given) {
        return closest.now(() => this.#alive(), rays, given);
    }

    closestHitsAsync(rays, given) {
        return closest.later(() => this.#alive(), rays, given, () => this.#version);
    }

    anyHits(rays, given) {
        return any.now(() => this.#alive(), rays, given);
    }

    anyHitsAsync(rays, given) {
        return any.later(() => this.#alive(), rays, given, () => this.#version);
    }

    windings(points, given) {
        return windings.now(() => this.#alive(), points, given);
    }

    windingsAsync(points, given) {
        return windings.later(() => this.#alive(), points, given, () => this.#version);
    }

    contains(points, given) {
        refuseInto(given);
        return inside(this.windings(points, given));
    }

    async containsAsync(points, given) {
        refuseInto(given);
        return inside(await this.windingsAsync(points, given));
    }

    closestPoints(points, given) {
        return near.now(() => this.#alive(), points, given);
    }

    closestPointsAsync(points, given) {
        return near.later(() => this.#alive(), points, given, () => this.#version);
    }

    closestHit(origin, direction, given) {
        const own = this.#alive();
        const known = options(given);
        const { accuracy, culling, ignore } = queryOptions(known);
        const { ray, hit } = oneRay(origin, direction, known);
        if (!call(() => own.closestHit(ray.own, hit.own, accuracy, culling, ignore))) return null;
        const [t, , u, v] = hit.floats;
        return { t, triangle: hit.words[1], u, v };
    }

    anyHit(origin, direction, given) {
        const own = this.#alive();
        const known = options(given);
        const { accuracy, culling, ignore } = queryOptions(known);
        const { ray } = oneRay(origin, direction, known);
        return call(() => own.anyHit(ray.own, accuracy, culling, ignore));
    }

    allHits(rays, given) {
        const own = this.#alive();
        const known = options(given);
        const side = choice(known.culling ?? "none", "culling", CULLINGS);
        const ignore = known.ignore === undefined || known.ignore === null ? NONE : count(known.ignore, "ignore");
        const most = limit(known.maxMemory);
        const watch = watcher(known);
        return withArrays([{ value: rays, what: "rays", type: Float32Array, each: 8 }], (asked) => {
            const ask = () => own.allHits(asked.own, asked.length / 8, side, ignore, most, watch.called);
            const all = watch.run(() => this.#calls.asking(ask));
            const [starts, crossings] = [new WasmArray(all.starts()), new WasmArray(all.crossings())];
            all.free();
            try {
                return allFound(starts.words, crossings.words);
            } finally {
                starts.free();
                crossings.free();
            }
        });
    }

    free() {
        if (this.#own !== null) {
            this.#calls.change();
            this.#own.free();
            this.#own = null;
        }
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}
