// The robot in three dimensions: bodies as rods from joint to joint, joints as drums along their axes.
import {
  AmbientLight, BoxGeometry, Color, CylinderGeometry, DirectionalLight, GridHelper, Group, Mesh, MeshLambertMaterial,
  PerspectiveCamera, Quaternion, Raycaster, Scene, SphereGeometry, Vector2, Vector3, WebGLRenderer,
} from "./vendor/three.module.js";
import { OrbitControls } from "./vendor/OrbitControls.js";
import { element, fill } from "./elements.mjs";

const BLUES = ["#cfe1f2", "#8fbce0", "#4a90c8", "#0b5394"]; // the more is seen of a link, the further from the paper
const SHADES = ["#8b929b", ...(matchMedia("(prefers-color-scheme: dark)").matches ? BLUES.toReversed() : BLUES)];
const WORDS = ["nothing of the link is seen", "less than a third", "less than two thirds", "most", "everything"];
const LIT = "#e07b00";
const STUB = 0.12; // length of a last body, of the robot's extent
const AWAY = 2; // of the camera, in extents: what is within one of them is in the picture
const TURN = 0.12; // rad, of an arrow key

export class Arm {
  constructor(canvas, legend, onLight) {
    this.canvas = canvas;
    this.onLight = onLight;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new Scene();
    this.scene.add(new AmbientLight(0xffffff, 1.6));
    this.sun = new DirectionalLight(0xffffff, 2);
    this.scene.add(this.sun);
    this.camera = new PerspectiveCamera(35, 1, 0.001, 1000);
    this.controls = null;
    this.links = new Group();
    this.materials = new Map();
    this.seen = "";
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("click", (event) => this.pick(event));
    const swatch = (shade) => {
      const box = element("i", { className: "swatch" });
      box.style.background = shade;
      return box;
    };
    fill(legend, SHADES.map((shade, level) => element("span", {}, swatch(shade), WORDS[level])));
  }

  show({ picture, bodies }) {
    const origins = picture.origins.map((at) => new Vector3(...at));
    const points = [new Vector3(), ...origins];
    const middle = points.reduce((sum, p) => sum.add(p), new Vector3()).divideScalar(points.length);
    const extent = Math.max(...points.map((p) => 2 * p.distanceTo(middle)), 1e-3);
    const level = new Map(bodies.map((body) => [body.index, body.level]));
    this.scene.remove(this.links);
    this.links = new Group();
    this.materials.clear();
    this.rod(new Vector3(), origins[picture.parents.indexOf(-1)], extent, -1, "#5d6670");
    origins.forEach((origin, index) => {
      const shade = SHADES[level.get(index) ?? 0];
      const axis = new Vector3(...picture.axes[index]);
      const ends = origins.filter((_, other) => picture.parents[other] === index);
      if (!ends.length) ends.push(this.tip(picture, origins, index, axis, extent));
      ends.forEach((end) => this.rod(origin, end, extent, index, shade));
      this.joint(origin, axis, picture.joints[index], extent, index, shade);
    });
    const up = new Vector3(...picture.up);
    const grid = new GridHelper(2 * extent, 10, 0x8a94a0, 0xaab3bd);
    grid.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), up);
    this.links.add(grid);
    this.scene.add(this.links);
    this.resize();
    const key = JSON.stringify(picture.parents);
    if (key !== this.seen) this.look(middle, up, extent);
    this.seen = key;
    this.render();
  }

  look(middle, up, extent) {
    const side = new Vector3(1, 0, 0).cross(up).lengthSq() > 0.1 ? new Vector3(1, 0, 0) : new Vector3(0, 1, 0);
    const front = side.clone().cross(up).normalize();
    this.camera.up.copy(up);
    const view = front.multiplyScalar(0.85).addScaledVector(side, 0.45).addScaledVector(up, 0.3).normalize();
    this.camera.position.copy(middle).addScaledVector(view, AWAY * extent * Math.max(1, 1 / this.camera.aspect));
    this.camera.near = 0.01 * extent;
    this.camera.far = 20 * extent;
    this.controls?.dispose();
    this.controls = new OrbitControls(this.camera, this.canvas); // it keeps the up direction of its beginning
    this.controls.enableZoom = false; // the wheel scrolls the page
    this.controls.enablePan = false;
    this.controls.addEventListener("change", () => this.render());
    this.controls.target.copy(middle);
    this.controls.update();
    this.sun.position.copy(this.camera.position);
  }

  tip(picture, origins, index, axis, extent) {
    const parent = picture.parents[index];
    const along = origins[index].clone().sub(parent < 0 ? new Vector3() : origins[parent]);
    if (along.length() < 1e-6 * extent) along.copy(axis.lengthSq() ? axis : new Vector3(...picture.up));
    return origins[index].clone().addScaledVector(along.normalize(), STUB * extent);
  }

  material(index, shade) {
    if (!this.materials.has(index)) {
      const made = new MeshLambertMaterial({ color: shade });
      made.userData.shade = shade;
      this.materials.set(index, made);
    }
    return this.materials.get(index);
  }

  place(geometry, at, along, index, shade) {
    const mesh = new Mesh(geometry, this.material(index, shade));
    mesh.position.copy(at);
    if (along.lengthSq()) mesh.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), along));
    mesh.userData.body = index;
    this.links.add(mesh);
  }

  rod(from, to, extent, index, shade) {
    const along = to.clone().sub(from);
    const length = along.length();
    if (length < 1e-6 * extent) return;
    const middle = from.clone().addScaledVector(along, 0.5);
    const radius = 0.014 * extent;
    this.place(new CylinderGeometry(radius, radius, length, 16), middle, along.normalize(), index, shade);
  }

  joint(at, axis, kind, extent, index, shade) {
    const r = 0.03 * extent;
    const geometry = kind === "slide" ? new BoxGeometry(1.5 * r, 3 * r, 1.5 * r)
      : kind === "fixed" || !axis.lengthSq() ? new SphereGeometry(0.7 * r, 16, 12)
      : new CylinderGeometry(r, r, 2.6 * r, 24);
    this.place(geometry, at, axis, index, shade);
  }

  light(index) {
    for (const [body, material] of this.materials) {
      material.color.copy(new Color(body === index ? LIT : material.userData.shade));
    }
    this.render();
  }

  pick(event) {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector2((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2(2 * at.x - 1, 1 - 2 * at.y), this.camera);
    const hit = caster.intersectObjects(this.links.children, false).find(({ object }) => object.userData.body >= 0);
    if (hit) this.onLight(hit.object.userData.body);
  }

  key(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!turns) return;
    event.preventDefault();
    const offset = this.camera.position.clone().sub(this.controls.target);
    const up = this.camera.up;
    const right = up.clone().cross(offset).normalize();
    offset.applyAxisAngle(up, TURN * turns[0]);
    const tilted = offset.clone().applyAxisAngle(right, TURN * turns[1]);
    if (Math.abs(tilted.clone().normalize().dot(up)) < 0.98) offset.copy(tilted);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.render();
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.render();
  }

  render() {
    this.renderer.render(this.scene, this.camera);
  }
}
