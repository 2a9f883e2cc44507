import type { BufferGeometry, Intersection, Mesh, Raycaster } from "three";
import type { BuildOptions, Tree } from "./index.js";

/** Assign it to `Mesh.prototype.raycast`. Without a tree a mesh is asked as three.js does it. */
export function acceleratedRaycast(this: Mesh, raycaster: Raycaster, intersects: Intersection[]): void;
/** Assign it to `BufferGeometry.prototype.computeBoundsTree`; call it again after the geometry has changed. */
export function computeBoundsTree(this: BufferGeometry, options?: BuildOptions): Tree;
/** Assign it to `BufferGeometry.prototype.disposeBoundsTree`. */
export function disposeBoundsTree(this: BufferGeometry): void;
/** Assigns all three. */
export function install(): void;

declare module "three" {
    interface BufferGeometry {
        boundsTree?: Tree | null;
        computeBoundsTree: typeof computeBoundsTree;
        disposeBoundsTree: typeof disposeBoundsTree;
    }
    interface Raycaster {
        /** Only the closest intersection of each mesh. */
        firstHitOnly?: boolean;
    }
}
