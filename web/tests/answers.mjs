// The lines of the snapshots of tests/web.rs, as the package gives them. For Node and for a browser: the package is handed in.

import { Hash, Numbers, bits, noise, rays, sphere } from "./meshes.mjs";

/** Columns as rows of words. */
function* records(columns) {
    const words = columns.map((column) => (column instanceof Float32Array ? bits(column) : column));
    for (let i = 0; i < words[0].length; i += 1) for (const column of words) yield column[i];
}

/** All hits of a batch. */
export function allLine(all) {
    const hash = new Hash().add(all.starts).add(records([all.t, all.triangle, all.u, all.v, all.front]));
    return `all: ${all.t.length} ${hash}`;
}

function answers(tree, scale, lines) {
    const asked = rays(3000, scale);
    for (const accuracy of ["fast", "watertight", "exact"]) {
        for (const culling of ["none", "back", "front"]) {
            const { t, triangle, u, v } = tree.closestHits(asked, { accuracy, culling });
            const found = triangle.filter((number) => number !== 0xffffffff).length;
            lines.push(`closest ${accuracy} ${culling}: ${found} ${Hash.of(records([t, triangle, u, v]))}`);
            lines.push(`any ${accuracy} ${culling}: ${Hash.of(tree.anyHits(asked, { accuracy, culling }))}`);
        }
    }
    lines.push(allLine(tree.allHits(asked)));
    const numbers = new Numbers(13);
    const points = Float32Array.from(Array.from({ length: 500 }, () => numbers.point(1.25 * scale)).flat());
    const { winding, boundary } = tree.windings(points);
    lines.push(`windings: ${Hash.of(records([winding, boundary]))}`);
    return points;
}

/** Closest points by their words: the package's columns have the root of the squared distance. */
function closestPoints(api, tree, points, scale) {
    const into = new api.WasmArray((8 * points.length) / 3);
    try {
        tree.closestPoints(points, { maxDistance: 0.5 * scale, into });
        return `closest points: ${Hash.of(into.words)}`;
    } finally {
        into.free();
    }
}

function ofMesh(api, { positions, indices }, scale) {
    const lines = [];
    for (const preset of ["fast", "narrow", "balanced", "best"]) {
        const tree = api.Tree.build(positions, indices, { preset });
        lines.push(`digest ${preset}: ${tree.digest}`);
        tree.free();
    }
    const tree = api.Tree.build(positions, indices);
    const bytes = tree.toBytes(positions, indices);
    lines.push(`file: ${bytes.length} ${Hash.of(bytes)}`);
    const points = answers(tree, scale, lines);
    lines.push(closestPoints(api, tree, points, scale));
    // A layout changes no answer, and neither does a file.
    const others = [api.Tree.build(positions, indices, { layout: "compact" }), api.Tree.load(bytes, positions, indices)];
    for (const other of others) {
        const again = [];
        answers(other, scale, again);
        again.push(closestPoints(api, other, points, scale));
        if (again.join("\n") !== lines.slice(5).join("\n")) throw new Error("answers differ by layout or file");
        other.free();
    }
    tree.free();
    return lines;
}

/** Puts forty instances of two meshes into a scene. */
function fill(scene) {
    const [ball, soup] = [sphere(6), noise(300)].map(({ positions, indices }) => scene.addGeometry(positions, indices));
    const numbers = new Numbers(17);
    for (let number = 0; number < 40; number += 1) {
        const transform = [];
        for (let row = 0; row < 3; row += 1) {
            const parts = [...numbers.point(0.25), Math.fround(numbers.next() * 4)];
            parts[row] = Math.fround(parts[row] + (number % 5 === 4 ? -0.75 : 0.75));
            transform.push(...parts);
        }
        scene.addInstance(number % 4 === 3 ? soup : ball, transform, { mask: 1 << number % 3 });
    }
}

function sceneLines(mask, { t, u, v, triangle, geometry, instance }, any) {
    const found = instance.filter((name) => name !== 0xffffffff).length;
    return [`closest ${mask}: ${found} ${Hash.of(records([t, u, v, triangle, geometry, instance]))}`, `any ${mask}: ${Hash.of(any)}`];
}

function instances(api) {
    const scene = new api.Scene();
    fill(scene);
    scene.update();
    const asked = rays(2000, 4);
    const lines = [`digest: ${scene.digest}`];
    for (const mask of [0xffffffff, 5]) lines.push(...sceneLines(mask, scene.closestHits(asked, { mask }), scene.anyHits(asked, { mask })));
    scene.free();
    return lines;
}

/** The same of a scene of either kind, by what both kinds have. */
export async function instancesAsync(scene) {
    fill(scene);
    await scene.updateAsync();
    const asked = rays(2000, 4);
    const lines = [`digest: ${scene.digest}`];
    for (const mask of [0xffffffff, 5]) {
        lines.push(...sceneLines(mask, await scene.closestHitsAsync(asked, { mask }), await scene.anyHitsAsync(asked, { mask })));
    }
    return lines;
}

/** By the snapshots' names. */
export function all(api) {
    return {
        web_sphere: ofMesh(api, sphere(24), 1),
        web_noise: ofMesh(api, noise(4000), 4),
        web_instances: instances(api),
    };
}

/** Pictures, by the part of the demonstration page that makes them. */
export function pictures({ Page, memory }) {
    const lines = [];
    for (const name of ["cornell", "spheres", "gallery", "city:3000"]) {
        const page = Page.builtin(name);
        page.build("fast", 1.5);
        for (const [number, accuracy] of ["fast", "watertight", "exact"].entries()) {
            page.frame(Uint32Array.of(96, 64, 1, 6, number, 1, 0, 0)).free();
            const pixels = new Uint32Array(memory.buffer, page.pixels(), page.count());
            lines.push(`${name} ${page.digest()} ${accuracy}: ${Hash.of(pixels)}`);
        }
        page.free();
    }
    return lines;
}

/** The first line that differs, or null. */
export function difference(found, snapshot) {
    const wanted = snapshot.split("---\n").slice(2).join("---\n").trimEnd().split("\n");
    for (let i = 0; i < Math.max(found.length, wanted.length); i += 1) {
        if (found[i] !== wanted[i]) return `line ${i + 1} is "${found[i]}", but natively "${wanted[i]}"`;
    }
    return null;
}
