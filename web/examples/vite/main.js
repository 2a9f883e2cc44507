// A mesh of three.js whose ray casts are splitplane's: move the pointer over it.

import { DirectionalLight, HemisphereLight, Mesh, MeshStandardMaterial, PerspectiveCamera, Raycaster, Scene, SphereGeometry, TorusKnotGeometry, Vector2, WebGLRenderer } from "three";
import { about, init } from "splitplane";
import { install } from "splitplane/three";

await init();
install();

const canvas = document.getElementById("view");
const told = document.getElementById("told");
const scene = new Scene();
const camera = new PerspectiveCamera(50, canvas.width / canvas.height, 0.1, 20);
camera.position.z = 5;
const light = new DirectionalLight(0xffffff, 2);
light.position.set(2, 3, 4);
scene.add(light, new HemisphereLight(0xffffff, 0x222222, 1));

const knot = new Mesh(new TorusKnotGeometry(1, 0.35, 400, 60), new MeshStandardMaterial({ color: 0x6fa8dc }));
const tree = knot.geometry.computeBoundsTree({ preset: "balanced" });
const mark = new Mesh(new SphereGeometry(0.04), new MeshStandardMaterial({ color: 0xcc0000 }));
mark.visible = false;
scene.add(knot, mark);
const { triangles } = tree.summary;
told.textContent = `${triangles.toLocaleString("en")} triangles, digest ${tree.digest}, ${about().instructionSet}`;

const renderer = new WebGLRenderer({ canvas, antialias: true });
const raycaster = new Raycaster();
raycaster.firstHitOnly = true;
const draw = () => renderer.render(scene, camera);
draw();

canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => {
    raycaster.setFromCamera(new Vector2((2 * offsetX) / canvas.clientWidth - 1, 1 - (2 * offsetY) / canvas.clientHeight), camera);
    const [hit] = raycaster.intersectObject(knot);
    mark.visible = hit !== undefined;
    if (hit !== undefined) mark.position.copy(hit.point);
    told.textContent = hit === undefined ? "nothing" : `triangle ${hit.faceIndex}, ${hit.distance.toFixed(4)} away`;
    draw();
});
