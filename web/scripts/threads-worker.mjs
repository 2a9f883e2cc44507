// What scripts/threads.mjs times, in a worker with so many threads.

import * as api from "/js/index.js";
import { raySets, readObj } from "/scripts/rates.mjs";
import { Hash, Numbers, sphere } from "/tests/meshes.mjs";

let mesh = null;
let tree = null;
const sets = {};

async function begin({ threads, text, count }) {
    if (threads === 0) await api.init();
    else await api.initThreads({ threads });
    mesh = text === null ? sphere(150) : readObj(text);
    for (const [name, rays] of Object.entries(raySets(mesh.positions, count, new Numbers(3)))) {
        const asked = new api.WasmArray(rays.length);
        asked.floats.set(rays);
        sets[name] = { asked, into: new api.WasmArray(rays.length / 2) };
    }
    tree = api.Tree.build(mesh.positions, mesh.indices, { preset: "balanced" });
    return { digest: tree.digest, triangles: tree.summary.triangles };
}

/** Milliseconds of each thing, and a hash of all answers. */
function round() {
    const took = {};
    for (const preset of ["balanced", "best"]) {
        const since = performance.now();
        const own = api.Tree.build(mesh.positions, mesh.indices, { preset });
        took[preset] = performance.now() - since;
        own.free();
    }
    const answers = new Hash();
    for (const [name, { asked, into }] of Object.entries(sets)) {
        const since = performance.now();
        tree.closestHits(asked, { into });
        took[name] = performance.now() - since;
        answers.add(into.words);
    }
    return { ...took, answers: answers.toString() };
}

onmessage = async ({ data }) => {
    try {
        postMessage(data === "round" ? round() : await begin(data));
    } catch (error) {
        postMessage({ error: String(error.stack ?? error) });
    }
};
