// Builds with progress on three threads, as often as it is told or until one fails, and prints how that ended; see threads-planted.mjs.

import * as api from "../js/node.js";
import { noise } from "./meshes.mjs";
import { failure } from "./threads-answers.mjs";

await api.initThreads({ threads: 3 });
const { positions, indices } = noise(60_000);
let built = null;
for (let round = 0; round < Number(process.argv[2]) && built === null; round += 1) {
    built = await failure(api, () => api.Tree.build(positions, indices, { progress() {} }).free());
}
const later = await failure(api, () => api.Tree.build(positions.subarray(0, 9)));
console.log(JSON.stringify({ built, later, isReady: api.isReady() }));
