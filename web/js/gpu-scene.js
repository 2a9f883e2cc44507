// Scenes of many objects on a browser's GPU.

import { room } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { call, hasCrashed, movedAll, settled } from "./gpu-module.js";
import { Instances } from "./instances.js";
import { buildOptions, meshArrays } from "./mesh.js";
import { options, watcher } from "./module.js";
import { sceneHits } from "./queries.js";
import { prepare } from "./scene.js";

/** Instances of meshes on a GPU; see index.d.ts. */
export class GpuScene extends Instances {
    #own;
    #part;

    constructor(own, loaded) {
        if (loaded === undefined || !(own instanceof loaded.raw.GpuScene)) throw new SplitplaneError("type", "a GpuScene is made by Gpu.scene");
        super(() => this.#alive(), call);
        this.#own = own;
        this.#part = loaded;
    }

    #alive() {
        if (this.#own === null) throw new SplitplaneError("freed", "this GpuScene was freed");
        return this.#own;
    }

    addGeometry(positions, indices) {
        const own = this.#alive();
        const { isIndexed, arrays } = meshArrays(positions, indices);
        const made = movedAll(this.#part, arrays);
        try {
            return call(() => own.addGeometry(...made, isIndexed));
        } finally {
            if (!hasCrashed()) for (const words of made) words.free();
        }
    }

    async updateAsync(given) {
        const own = this.#alive();
        const known = options(given);
        const [preset, , maxMemory] = buildOptions(known);
        const watch = watcher(known);
        watch.begin();
        await watch.later(() => settled(() => own.update(preset, maxMemory, watch.called)));
    }

    /** Asks, and hands what comes back, as words, to `give`. */
    async #ask(name, rays, given, answerWords, give) {
        const own = this.#alive();
        const known = options(given);
        const { numbers, into } = prepare(known);
        const watch = watcher(known);
        watch.begin();
        const total = (rays?.length ?? 0) / 8;
        if (into !== undefined) room(into, rays, answerWords(total), "the answers");
        const [asked] = movedAll(this.#part, [{ what: "rays", type: Float32Array, each: 8, value: rays }]);
        const words = await watch.later(() => settled(() => own[name](asked, numbers, watch.called)));
        try {
            const found = new Uint32Array(this.#part.memory.buffer, words.pointer(), words.length());
            if (into === undefined) return give(found, total);
            into.words.set(found);
            return into;
        } finally {
            if (!hasCrashed()) words.free();
        }
    }

    closestHitsAsync(rays, given) {
        return this.#ask("closestHits", rays, given, (total) => 6 * total, sceneHits);
    }

    anyHitsAsync(rays, given) {
        return this.#ask("anyHits", rays, given, (total) => Math.ceil(total / 4), (words, total) =>
            new Uint8Array(words.buffer, words.byteOffset, total).slice(),
        );
    }

    free() {
        if (this.#own !== null) {
            if (!hasCrashed()) this.#own.free();
            this.#own = null;
        }
    }
}
