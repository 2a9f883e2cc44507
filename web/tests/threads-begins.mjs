// Starts three threads, lets them share work, and prints how many there were; see threads.test.mjs.

import * as api from "../js/node.js";
import { noise } from "./meshes.mjs";

await api.initThreads({ threads: 3 });
const { positions, indices } = noise(2_000);
const tree = api.Tree.build(positions, indices);
console.log(JSON.stringify({ threads: api.about().threads, digest: tree.digest }));
