import { CULLINGS, NONE, batch, queryOptions } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { buildOptions, meshArrays } from "./mesh.js";
import { Calls, call, choice, count, options, pause, raw, watcher, withArrays } from "./module.js";
import { sceneHits } from "./queries.js";

/** All bits of a mask. */
export const ALL = 0xffffffff;

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

/** Three rows of four, from 12 numbers by rows or the 16 of a column-major matrix, as WebGL and three.js have them. */
export function rows(matrix) {
    const length = matrix?.length;
    if (length !== 12 && length !== 16) {
        throw new SplitplaneError("shape", `a matrix has ${length} numbers, but must have 12 (by rows) or 16 (by columns)`);
    }
    const all = Array.from(matrix);
    if (!all.every((part) => typeof part === "number")) throw new SplitplaneError("type", "a matrix must be of numbers");
    if (length === 12) return Float32Array.from(all);
    if (all[3] !== 0 || all[7] !== 0 || all[11] !== 0 || all[15] !== 1) {
        throw new SplitplaneError("shape", "a matrix of 16 numbers must be affine: its last row 0, 0, 0, 1");
    }
    return Float32Array.from({ length: 12 }, (_, place) => all[4 * (place % 4) + Math.floor(place / 4)]);
}

/** Instances of meshes; see index.d.ts. */
export class Scene {
    #own;
    #calls = new Calls("Scene");

    constructor() {
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

    removeGeometry(geometry) {
        const own = this.#alive();
        count(geometry, "geometry");
        call(() => own.removeGeometry(geometry));
    }

    addInstance(geometry, matrix, given) {
        const own = this.#alive();
        const { mask = ALL, culling = "none" } = options(given);
        count(geometry, "geometry");
        count(mask, "mask", ALL);
        const [transform, side] = [rows(matrix), choice(culling, "culling", CULLINGS)];
        return call(() => own.addInstance(geometry, transform, mask, side));
    }

    moveInstance(instance, matrix) {
        const own = this.#alive();
        count(instance, "instance");
        const transform = rows(matrix);
        call(() => own.moveInstance(instance, transform));
    }

    removeInstance(instance) {
        const own = this.#alive();
        count(instance, "instance");
        call(() => own.removeInstance(instance));
    }

    update(given) {
        const own = this.#alive();
        const known = options(given);
        const settings = buildOptions(known);
        const watch = watcher(known);
        watch.run(() => this.#calls.changing(() => own.update(...settings, watch.called)));
    }

    /** The same after the event loop has had a turn; the work itself is in one piece. */
    async updateAsync(given) {
        await pause();
        this.update(given);
    }

    get digest() {
        return call(() => this.#alive().digest());
    }

    closestHits(rays, given) {
        return closest.now(() => this.#alive(), rays, given);
    }

    closestHitsAsync(rays, given) {
        return closest.later(() => this.#alive(), rays, given);
    }

    anyHits(rays, given) {
        return any.now(() => this.#alive(), rays, given);
    }

    anyHitsAsync(rays, given) {
        return any.later(() => this.#alive(), rays, given);
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
