// Against three.js's own Raycaster, which tests every triangle.

import assert from "node:assert/strict";
import { test } from "node:test";

import * as three from "three";

import { SplitplaneError, init } from "../js/node.js";
import { acceleratedRaycast, computeBoundsTree, disposeBoundsTree, install } from "../js/three.js";
import { Numbers } from "./meshes.mjs";

await init();
const { Mesh, BufferGeometry, Raycaster, Vector3 } = three;
const plain = Mesh.prototype.raycast;

/** Both ways, on the same ray. */
function both(mesh, raycaster) {
    Mesh.prototype.raycast = plain;
    const wanted = raycaster.intersectObject(mesh);
    install();
    const found = raycaster.intersectObject(mesh);
    Mesh.prototype.raycast = plain;
    return { wanted, found };
}

function near(a, b, text, slack = 2e-4) {
    assert.ok(Math.abs(a - b) <= slack * (1 + Math.abs(b)), `${text}: ${a} is not ${b}`);
}

function same(found, wanted) {
    assert.equal(found.object, wanted.object);
    assert.equal(found.faceIndex, wanted.faceIndex);
    near(found.distance, wanted.distance, "distance");
    for (const axis of ["x", "y", "z"]) {
        near(found.point[axis], wanted.point[axis], `point ${axis}`);
        near(found.face.normal[axis], wanted.face.normal[axis], `normal ${axis}`);
        near(found.barycoord[axis], wanted.barycoord[axis], `weight ${axis}`, 5e-3);
        if (wanted.normal) near(found.normal[axis], wanted.normal[axis], `smooth normal ${axis}`, 5e-3);
    }
    for (const name of ["a", "b", "c", "materialIndex"]) assert.equal(found.face[name], wanted.face[name]);
    for (const name of ["uv", "uv1"]) {
        assert.equal(name in found, name in wanted && wanted[name] !== undefined);
        if (wanted[name]) for (const axis of ["x", "y"]) near(found[name][axis], wanted[name][axis], `${name} ${axis}`, 5e-3);
    }
    assert.deepEqual(Object.keys(found).sort(), Object.keys(wanted).filter((key) => wanted[key] !== undefined).sort());
}

function geometries() {
    const knot = new three.TorusKnotGeometry(1, 0.3, 48, 12);
    const soup = new three.IcosahedronGeometry(1.2, 4);
    const box = new three.BoxGeometry(1, 2, 1.5, 3, 3, 3);
    const interleaved = new BufferGeometry();
    const data = new three.InterleavedBuffer(new Float32Array(5 * soup.attributes.position.count), 5);
    const attribute = new three.InterleavedBufferAttribute(data, 3, 1);
    for (let i = 0; i < attribute.count; i += 1) {
        attribute.setXYZ(i, soup.attributes.position.getX(i), soup.attributes.position.getY(i), soup.attributes.position.getZ(i));
    }
    interleaved.setAttribute("position", attribute);
    return { knot, soup, box, interleaved };
}

const sides = { FrontSide: three.FrontSide, BackSide: three.BackSide, DoubleSide: three.DoubleSide };

for (const [name, geometry] of Object.entries(geometries())) {
    for (const [sideName, side] of Object.entries(sides)) {
        test(`${name}, ${sideName}: the intersections of three.js`, () => {
            computeBoundsTree.call(geometry);
            const numbers = new Numbers(5);
            let hits = 0;
            for (let i = 0; i < 150; i += 1) {
                const mesh = new Mesh(geometry, new three.MeshBasicMaterial({ side }));
                mesh.position.set(...numbers.point(1));
                mesh.rotation.set(...numbers.point(3));
                // Mirrored and stretched ones among them.
                mesh.scale.set(0.75 + numbers.next() / 2, 1 + numbers.next() / 2, i % 5 === 0 ? -1.5 : 1.5);
                mesh.updateMatrixWorld(true);
                const origin = new Vector3(...numbers.point(4));
                const direction = new Vector3(...numbers.point(1)).sub(origin).normalize();
                const raycaster = new Raycaster(origin, direction, i % 7 === 0 ? 2 : 0, i % 3 === 0 ? 4 : Infinity);
                const { wanted, found } = both(mesh, raycaster);
                assert.equal(found.length, wanted.length, `ray ${i}`);
                found.forEach((hit, place) => same(hit, wanted[place]));
                hits += found.length;
                raycaster.firstHitOnly = true;
                const { found: first } = both(mesh, raycaster);
                assert.equal(first.length, Math.min(1, wanted.length));
                if (first.length > 0) same(first[0], wanted[0]);
            }
            assert.ok(hits > 30, `only ${hits} hits`);
            disposeBoundsTree.call(geometry);
            assert.equal(geometry.boundsTree, null);
        });
    }
}

test("groups, materials and the range that is drawn", () => {
    const geometry = new three.BoxGeometry(2, 2, 2, 2, 2, 2);
    computeBoundsTree.call(geometry);
    const materials = Array.from({ length: 6 }, (_, i) => new three.MeshBasicMaterial({ side: Object.values(sides)[i % 3] }));
    const numbers = new Numbers(6);
    let hits = 0;
    for (let i = 0; i < 200; i += 1) {
        geometry.setDrawRange(i % 4 === 0 ? 12 : 0, i % 4 === 1 ? 60 : Infinity);
        const mesh = new Mesh(geometry, i % 2 === 0 ? materials : materials[i % 6]);
        const origin = new Vector3(...numbers.point(4));
        const raycaster = new Raycaster(origin, new Vector3(...numbers.point(1)).sub(origin).normalize());
        const { wanted, found } = both(mesh, raycaster);
        assert.equal(found.length, wanted.length, `ray ${i}`);
        found.forEach((hit, place) => same(hit, wanted[place]));
        hits += found.length;
        raycaster.firstHitOnly = true;
        const { found: first } = both(mesh, raycaster);
        assert.equal(first.length, Math.min(1, wanted.length));
        if (first.length > 0) same(first[0], wanted[0]);
    }
    assert.ok(hits > 100, `only ${hits} hits`);
});

test("what has no tree is asked as three.js does it, and errors are the package's", () => {
    install();
    const mesh = new Mesh(new three.SphereGeometry(1, 16, 8));
    const raycaster = new Raycaster(new Vector3(0.01, 0.02, 5), new Vector3(0, 0, -1));
    assert.equal(raycaster.intersectObject(mesh).length, 1);
    mesh.geometry.computeBoundsTree();
    const digest = mesh.geometry.boundsTree.digest;
    mesh.geometry.scale(2, 2, 2);
    mesh.geometry.computeBoundsTree();
    assert.notEqual(mesh.geometry.boundsTree.digest, digest);
    assert.equal(Math.round(raycaster.intersectObject(mesh)[0].distance), 3);
    assert.throws(() => mesh.geometry.computeBoundsTree({ preset: "?" }), SplitplaneError);
    mesh.geometry.disposeBoundsTree();
    assert.equal(raycaster.intersectObject(mesh).length, 1);
    assert.throws(() => new BufferGeometry().computeBoundsTree(), /no positions/);
    Mesh.prototype.raycast = plain;
});

test("a planted fault is found", () => {
    const mesh = new Mesh(new three.TorusKnotGeometry(1, 0.3, 48, 12));
    mesh.geometry.boundsTree = computeBoundsTree.call(mesh.geometry);
    mesh.material.side = three.DoubleSide;
    // Through the middle of a triangle.
    const [a, b, c] = [0, 1, 2].map((corner) => mesh.getVertexPosition(mesh.geometry.index.getX(corner), new Vector3()));
    const middle = a.add(b).add(c).divideScalar(3);
    const raycaster = new Raycaster(middle.clone().add(new Vector3(0, 0, 5)), new Vector3(0, 0, -1));
    const intersects = [];
    acceleratedRaycast.call(mesh, raycaster, intersects);
    assert.ok(intersects.length > 0);
    const wrong = { ...intersects[0], faceIndex: intersects[0].faceIndex + 1 };
    assert.throws(() => same(wrong, intersects[0]));
    const far = { ...intersects[0], distance: intersects[0].distance * 1.01 };
    assert.throws(() => same(far, intersects[0]));
});
