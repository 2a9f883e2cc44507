// Ray casts of three.js by splitplane: the names are those that three-mesh-bvh gave its functions, so that programs change an import.

import { BackSide, BufferGeometry, DoubleSide, Mesh, Ray, Matrix4, Triangle, Vector2, Vector3 } from "three";

import { Tree } from "./tree.js";

const plainRaycast = Mesh.prototype.raycast;

/** Positions of a geometry as floats, three each, whatever attribute they are in. */
function positionsOf(geometry) {
    const attribute = geometry.getAttribute("position");
    if (attribute === undefined) throw new TypeError("computeBoundsTree: the geometry has no positions");
    const isPlain = attribute.array instanceof Float32Array && !attribute.isInterleavedBufferAttribute && attribute.itemSize === 3;
    if (isPlain) return attribute.array.subarray(0, 3 * attribute.count);
    const positions = new Float32Array(3 * attribute.count);
    for (let i = 0; i < attribute.count; i += 1) {
        positions.set([attribute.getX(i), attribute.getY(i), attribute.getZ(i)], 3 * i);
    }
    return positions;
}

/** Corners of the triangles, whole ones only. */
function indicesOf(geometry) {
    const { index } = geometry;
    const count = index === null ? geometry.getAttribute("position").count : index.count;
    const whole = count - (count % 3);
    if (index === null) return Uint32Array.from({ length: whole }, (_, i) => i);
    return index.array instanceof Uint32Array ? index.array.subarray(0, whole) : Uint32Array.from(index.array.subarray(0, whole));
}

/** Builds the geometry's tree as `geometry.boundsTree`, and gives it. `options` as for `Tree.build`. */
export function computeBoundsTree(options) {
    const [positions, indices] = [positionsOf(this), indicesOf(this)];
    if (this.boundsTree instanceof Tree) this.boundsTree.rebuild(positions, indices, options);
    else this.boundsTree = Tree.build(positions, indices, options);
    return this.boundsTree;
}

export function disposeBoundsTree() {
    if (this.boundsTree instanceof Tree) this.boundsTree.free();
    this.boundsTree = null;
}

const inverse = new Matrix4();
const ray = new Ray();
const a = new Vector3();
const b = new Vector3();
const c = new Vector3();
const barycentric = new Vector3();
const corners = [a, b, c];

/** What a material lets rays through from: three.js shows fronts only unless told otherwise. */
function cullingOf(material) {
    if (material.side === DoubleSide) return "none";
    return material.side === BackSide ? "front" : "back";
}

/** The material of a triangle, and its number; of several the one of its group. `null` for a triangle that is not drawn. */
function materialOf(mesh, triangle) {
    const { geometry, material } = mesh;
    const first = 3 * triangle;
    const { start, count } = geometry.drawRange;
    if (first < start || first + 3 > start + count) return null;
    if (!Array.isArray(material)) return { material, materialIndex: 0 };
    for (const group of geometry.groups) {
        if (first >= group.start && first + 3 <= group.start + group.count) {
            const own = material[group.materialIndex];
            return own === undefined ? null : { material: own, materialIndex: group.materialIndex };
        }
    }
    return null;
}

/** A number pair of an attribute between the corners of a triangle. */
function between(attribute, [i, j, k], weights) {
    const pair = new Vector2();
    for (const [corner, weight] of [[i, weights.x], [j, weights.y], [k, weights.z]]) {
        pair.x += attribute.getX(corner) * weight;
        pair.y += attribute.getY(corner) * weight;
    }
    return pair;
}

/** The intersection that three.js would give. */
function intersection(mesh, raycaster, found, triangle, t, materialIndex) {
    const { geometry } = mesh;
    const { index } = geometry;
    const position = geometry.getAttribute("position");
    const named = [0, 1, 2].map((corner) => (index === null ? 3 * triangle + corner : index.getX(3 * triangle + corner)));
    corners.forEach((corner, place) => corner.fromBufferAttribute(position, named[place]));
    // On the triangle, whatever t is rounded to.
    barycentric.set(1 - found.u - found.v, found.u, found.v);
    const point = new Vector3();
    point.addScaledVector(a, barycentric.x).addScaledVector(b, barycentric.y).addScaledVector(c, barycentric.z);
    point.applyMatrix4(mesh.matrixWorld);
    const normal = Triangle.getNormal(a, b, c, new Vector3());
    const hit = {
        distance: raycaster.ray.origin.distanceTo(point),
        point,
        object: mesh,
        faceIndex: triangle,
        face: { a: named[0], b: named[1], c: named[2], normal, materialIndex },
        barycoord: barycentric.clone(),
    };
    for (const [key, name] of [["uv", "uv"], ["uv1", "uv1"]]) {
        const attribute = geometry.getAttribute(name);
        if (attribute !== undefined) hit[key] = between(attribute, named, barycentric);
    }
    const normals = geometry.getAttribute("normal");
    if (normals !== undefined) {
        hit.normal = new Vector3();
        named.forEach((corner, place) => {
            hit.normal.addScaledVector(a.fromBufferAttribute(normals, corner), barycentric.getComponent(place));
        });
        if (hit.normal.dot(ray.direction) > 0) hit.normal.negate();
    }
    return hit;
}

/**
 * In the place of `Mesh.prototype.raycast`: by the tree of `geometry.boundsTree`, or as three.js does it where there is none. With
 * `raycaster.firstHitOnly` only the closest intersection is given.
 */
export function acceleratedRaycast(raycaster, intersects) {
    const { geometry, material } = this;
    const tree = geometry.boundsTree;
    if (!(tree instanceof Tree) || this.isSkinnedMesh || geometry.morphAttributes.position !== undefined) {
        plainRaycast.call(this, raycaster, intersects);
        return;
    }
    if (material === undefined) return;
    // The direction keeps the length that it has in the mesh's space, so that t is the distance in the world.
    inverse.copy(this.matrixWorld).invert();
    ray.origin.copy(raycaster.ray.origin).applyMatrix4(inverse);
    ray.direction.copy(raycaster.ray.direction).applyMatrix4(inverse.setPosition(0, 0, 0));
    const [origin, direction] = [ray.origin.toArray(), ray.direction.toArray()];
    const limits = { tMin: Math.max(0, raycaster.near), tMax: raycaster.far };
    const { drawRange } = geometry;
    const drawsAll = drawRange.start === 0 && drawRange.count === Infinity;
    if (raycaster.firstHitOnly === true && !Array.isArray(material) && drawsAll) {
        const hit = tree.closestHit(origin, direction, { ...limits, culling: cullingOf(material) });
        if (hit !== null) intersects.push(intersection(this, raycaster, hit, hit.triangle, hit.t, 0));
        return;
    }
    const all = tree.allHits(Float32Array.of(...origin, limits.tMin, ...direction, limits.tMax));
    for (let place = 0; place < all.t.length; place += 1) {
        const own = materialOf(this, all.triangle[place]);
        if (own === null) continue;
        const culling = cullingOf(own.material);
        if (culling === (all.front[place] === 1 ? "front" : "back")) continue;
        const found = { u: all.u[place], v: all.v[place] };
        intersects.push(intersection(this, raycaster, found, all.triangle[place], all.t[place], own.materialIndex));
        if (raycaster.firstHitOnly === true) return;
    }
}

/** Does all three: `Mesh.raycast`, `BufferGeometry.computeBoundsTree` and `disposeBoundsTree`. */
export function install() {
    Mesh.prototype.raycast = acceleratedRaycast;
    BufferGeometry.prototype.computeBoundsTree = computeBoundsTree;
    BufferGeometry.prototype.disposeBoundsTree = disposeBoundsTree;
}
