// Scenes of many objects, on the CPU.

import { NONE, batch, queryOptions } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { ALL, Instances } from "./instances.js";
import { buildOptions, meshArrays } from "./mesh.js";
import { Calls, call, count, options, pause, raw, watcher, withArrays } from "./module.js";
import { sceneHits } from "./queries.js";

/** Accuracy, culling, mask, ignored instance and triangle, as the compiled part takes them. */
export function prepare(given) {
    const { mask = ALL, ignore } = given;
    count(mask, "mask", ALL);
    const { accuracy, culling, into } = queryOptions({ ...given, ignore: undefined });
    let [instance, triangle] = [NONE, NONE];
    if (ignore !== undefined && ignore !== null) {
        [instance, triangle] = [count(ignore.instance, "ignore.instance"), count(ignore.triangle, "ignore.triangle")];
    }
    return { numbers: Uint32Array.of(accuracy, culling, mask, instance, triangle), into };
}

const closest = batch({
    what: "rays",
    type: Float32Array,
    each: 8,
    answerWords: (total) => 6 * total,
    prepare,
    ask: (own, rays, hits, first, some, { numbers }) => own.closestHits(rays, hits, first, some, numbers),
    give: (hits, total) => sceneHits(hits.words, total),
});

const any = batch({
    what: "rays",
    type: Float32Array,
    each: 8,
    answerWords: (total) => Math.ceil(total / 4),
    prepare,
    ask: (own, rays, occluded, first, some, { numbers }) => own.anyHits(rays, occluded, first, some, numbers),
    give: (occluded, total) => occluded.bytes.slice(0, total),
});

/** Instances of meshes; see index.d.ts. */
export class Scene extends Instances {
    #own;
    #calls = new Calls("Scene");
    #version = 0;

    constructor() {
        super(() => this.#alive(), call);
        this.#own = call(() => new raw.Scene());
    }

    #alive() {
        if (this.#own === null) throw new SplitplaneError("freed", "this Scene was freed");
        this.#calls.ask();
        return this.#own;
    }

    addGeometry(positions, indices) {
        const own = this.#alive();
        const { isIndexed, arrays } = meshArrays(positions, indices);
        return withArrays(arrays, (points, corners) => call(() => own.addGeometry(points.own, corners.own, isIndexed)));
    }

    update(given) {
        const own = this.#alive();
        const known = options(given);
        const settings = buildOptions(known);
        const watch = watcher(known);
        watch.run(() => {
            this.#calls.changing(() => own.update(...settings, watch.called));
            // After a failure batches that are under way go on with the scene that they began with.
            this.#version += 1;
        });
    }

    /** The same after the event loop has had a turn; the work itself is in one piece. */
    async updateAsync(given) {
        await pause();
        this.update(given);
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

    free() {
        if (this.#own !== null) {
            this.#calls.change();
            this.#own.free();
            this.#own = null;
        }
    }
}
