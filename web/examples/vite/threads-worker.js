// Traces a million rays: on all cores where the page is isolated, else on one thread.

import { NONE, Tree, about, init, initThreads, whyNoThreads } from "splitplane";

const why = whyNoThreads();
if (why === null) await initThreads();
else await init();

// A field of hills, and rays that look down on it.
const side = 400;
const height = (x, y) => Math.sin(x / 9) * Math.cos(y / 7);
const positions = Float32Array.from({ length: 3 * side * side }, (_, i) => {
    const [x, y] = [Math.floor(i / 3) % side, Math.floor(i / 3 / side)];
    return [x, y, height(x, y)][i % 3];
});
const indices = [];
for (let y = 0; y + 1 < side; y += 1) {
    for (let x = 0; x + 1 < side; x += 1) {
        const corner = y * side + x;
        indices.push(corner, corner + 1, corner + side, corner + side, corner + 1, corner + side + 1);
    }
}
const rays = new Float32Array(8e6);
for (let i = 0; i < 1e6; i += 1) rays.set([0.4 * (i % 1000), 0.4 * Math.floor(i / 1000), 9, 0, 0.1, 0.2, -1, Infinity], 8 * i);

const tree = Tree.build(positions, Uint32Array.from(indices));
const since = performance.now();
const { triangle } = tree.closestHits(rays);
const took = performance.now() - since;
const found = triangle.reduce((sum, one) => sum + Number(one !== NONE), 0);
postMessage({ threads: about().threads, why, digest: tree.digest, found, took });
