// The ways of tracing rays that scripts/speed.mjs compares: for Node, and for a page.

/** From a camera, in rows; and from anywhere to anywhere in the box. `numbers` gives numbers from -1 to 1. */
export function raySets(positions, total, numbers) {
    const [lo, hi] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    positions.forEach((x, i) => {
        lo[i % 3] = Math.min(lo[i % 3], x);
        hi[i % 3] = Math.max(hi[i % 3], x);
    });
    const size = Math.hypot(...hi.map((x, axis) => x - lo[axis]));
    const middle = hi.map((x, axis) => (x + lo[axis]) / 2);
    const width = Math.ceil(Math.sqrt(total));
    const [primary, chords] = [new Float32Array(8 * total), new Float32Array(8 * total)];
    const within = () => numbers.point(1).map((x, axis) => middle[axis] + (x * (hi[axis] - lo[axis])) / 2);
    for (let i = 0; i < total; i += 1) {
        const [x, y] = [(i % width) / width - 0.5, Math.floor(i / width) / width - 0.5];
        const eye = [middle[0] + 0.3 * size, middle[1] + 0.2 * size, middle[2] + 0.9 * size];
        const to = [middle[0] + x * size * 0.8, middle[1] - y * size * 0.8, middle[2]];
        primary.set([...eye, 0, ...to.map((part, axis) => part - eye[axis]), Infinity], 8 * i);
        const [a, b] = [within(), within()];
        chords.set([...a, 0, ...b.map((part, axis) => part - a[axis]), Infinity], 8 * i);
    }
    return { primary, chords };
}

/** Positions and triangles of an OBJ file: of each face the fan around its first corner. */
export function readObj(text) {
    const [positions, indices] = [[], []];
    for (const line of text.split("\n")) {
        const words = line.trim().split(/\s+/);
        if (words[0] === "v") positions.push(...words.slice(1, 4).map(Number));
        if (words[0] !== "f") continue;
        const corners = words.slice(1).map((word) => {
            const number = parseInt(word, 10);
            return number < 0 ? positions.length / 3 + number : number - 1;
        });
        for (let i = 2; i < corners.length; i += 1) indices.push(corners[0], corners[i - 1], corners[i]);
    }
    return { positions: Float32Array.from(positions), indices: Uint32Array.from(indices) };
}

const timed = (work) => {
    const since = performance.now();
    work();
    return performance.now() - since;
};

/** The ways, in the order of a round. */
export const WAYS = ["splitplane, a batch", "splitplane, ray by ray", "three-mesh-bvh, ray by ray"];

export class Bench {
    /** Builds both trees. `api`, `three` and `theirs` are the modules. */
    constructor(api, three, { MeshBVH, SAH }, { positions, indices }) {
        Object.assign(this, { api, three });
        this.builds = [timed(() => (this.tree = api.Tree.build(positions, indices, { preset: "balanced" }))), 0];
        const geometry = new three.BufferGeometry();
        geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
        geometry.setIndex(new three.BufferAttribute(indices.slice(), 1));
        this.builds[1] = timed(() => (this.bvh = new MeshBVH(geometry, { strategy: SAH })));
    }

    /** Takes other rays. */
    take(rays) {
        const { api, three, tree, bvh } = this;
        this.asked?.free();
        this.into?.free();
        const total = rays.length / 8;
        const [asked, into] = [new api.WasmArray(rays.length), new api.WasmArray(4 * total)];
        asked.floats.set(rays);
        const t = new Float32Array(total);
        const ray = new three.Ray(new three.Vector3(), new three.Vector3());
        const lengths = new Float64Array(total);
        const directions = new Float64Array(3 * total);
        for (let i = 0; i < total; i += 1) {
            const direction = rays.subarray(8 * i + 4, 8 * i + 7);
            lengths[i] = Math.hypot(...direction);
            for (let axis = 0; axis < 3; axis += 1) directions[3 * i + axis] = direction[axis] / lengths[i];
        }
        Object.assign(this, { total, asked, into, t });
        this.ways = {
            [WAYS[0]]: () => tree.closestHits(asked, { into }),
            [WAYS[1]]: () => {
                for (let i = 0; i < total; i += 1) tree.closestHit(rays.subarray(8 * i, 8 * i + 3), rays.subarray(8 * i + 4, 8 * i + 7));
            },
            [WAYS[2]]: () => {
                for (let i = 0; i < total; i += 1) {
                    ray.origin.set(rays[8 * i], rays[8 * i + 1], rays[8 * i + 2]);
                    ray.direction.set(directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]);
                    t[i] = (bvh.raycastFirst(ray, three.DoubleSide)?.distance ?? Infinity) / lengths[i];
                }
            },
        };
    }

    /** A way, once: milliseconds by the clock. */
    run(way) {
        return timed(this.ways[way]);
    }

    /** How many distances differ between both by more than a part in 10,000. */
    differ() {
        let differ = 0;
        const { floats } = this.into;
        for (let i = 0; i < this.total; i += 1) {
            const [a, b] = [floats[4 * i], this.t[i]];
            if (!(a === b || Math.abs(a - b) <= 1e-4 * Math.max(1, Math.abs(a)))) differ += 1;
        }
        return differ;
    }
}
