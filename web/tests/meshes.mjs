// The meshes, rays and hashes of tests/web.rs, from the same single operations on floats of 32 bits.

const f = Math.fround;

export class Numbers {
    constructor(seed) {
        this.state = seed >>> 0;
    }

    next() {
        this.state = (Math.imul(this.state, 1664525) + 1013904223) >>> 0;
        return f((this.state >>> 8) / 8388608 - 1);
    }

    point(scale) {
        return [0, 1, 2].map(() => f(this.next() * f(scale)));
    }
}

/** FNV-1a of words. */
export class Hash {
    value = 0x811c9dc5;

    add(words) {
        for (const word of words) this.value = Math.imul(this.value ^ word, 0x01000193);
        return this;
    }

    toString() {
        return (this.value >>> 0).toString(16).padStart(8, "0");
    }

    static of(words) {
        return new Hash().add(words).toString();
    }
}

export function sphere(cuts) {
    const [positions, indices] = [[], []];
    for (let face = 0; face < 6; face += 1) {
        const first = positions.length / 3;
        for (let i = 0; i <= cuts; i += 1) {
            for (let j = 0; j <= cuts; j += 1) {
                const [a, b] = [i, j].map((k) => f(f(f(2 * k) / cuts) - 1));
                const side = face % 2 === 0 ? 1 : -1;
                const at = [[side, a, b * side], [b * side, side, a], [a, b * side, side]][face >> 1];
                const [x, y, z] = at;
                const length = f(Math.sqrt(f(f(f(x * x) + f(y * y)) + f(z * z))));
                positions.push(f(x / length), f(y / length), f(z / length));
            }
        }
        for (let i = 0; i < cuts; i += 1) {
            for (let j = 0; j < cuts; j += 1) {
                const corner = first + i * (cuts + 1) + j;
                const [right, below] = [corner + 1, corner + cuts + 1];
                indices.push(corner, below, right, right, below, below + 1);
            }
        }
    }
    return { positions: Float32Array.from(positions), indices: Uint32Array.from(indices) };
}

export function noise(count) {
    const numbers = new Numbers(7);
    const [positions, indices] = [[], []];
    for (let triangle = 0; triangle < count; triangle += 1) {
        const centre = numbers.point(4);
        for (let corner = 0; corner < 3; corner += 1) {
            const off = numbers.point(0.5);
            positions.push(...centre.map((x, axis) => f(x + off[axis])));
        }
        const first = 3 * triangle;
        indices.push(first, first + 1, triangle % 50 === 49 ? first : first + 2);
    }
    return { positions: Float32Array.from(positions), indices: Uint32Array.from(indices) };
}

export function rays(count, scale) {
    const numbers = new Numbers(11);
    const all = new Float32Array(8 * count);
    for (let i = 0; i < count; i += 1) {
        const [from, to] = [numbers.point(3 * scale), numbers.point(scale)];
        all.set([...from, 0, ...to.map((x, axis) => f(x - from[axis])), 4], 8 * i);
    }
    return all;
}

/** The bits of floats. */
export function bits(floats) {
    return new Uint32Array(floats.buffer, floats.byteOffset, floats.byteLength / 4);
}
