//! What the demonstration page calls, in a worker: a scene, its tree, and pictures of it.

mod boxes;
mod files;
mod heat;
mod judge;
#[cfg(feature = "gpu")]
mod on_gpu;
mod orbit;
mod picture;

use std::cell::RefCell;
use std::rc::Rc;

use js_sys::Function;
use splitplane::render::RenderSettings;
use splitplane::render::layout::FirstHit;
use splitplane::scene::{Placement, Scene, View, builtin};
use splitplane::tracer::{Tracer, TracerError};
use splitplane::{BuildOptions, CpuBackend};
use wasm_bindgen::prelude::*;

use crate::failure::Failure;
use crate::named::build_options;
use crate::progress::watched;
use crate::words::Words;
use boxes::Level;
use orbit::Orbit;
use picture::Told;
use picture::Wanted;

/// Most bytes of a file that is read: what is made of them takes several times as many, of the 4 GiB that a module can have.
const MOST_BYTES: u32 = 384 << 20;

/// A scene whose tree is built.
#[wasm_bindgen]
pub struct Page {
    /// Shared with work on a GPU that is under way.
    scene: Rc<Scene>,
    tracer: Option<Tracer>,
    /// The same scene on a GPU. Work that is under way has taken it.
    #[cfg(feature = "gpu")]
    on_gpu: Rc<RefCell<Option<Tracer>>>,
    orbit: Option<Orbit>,
    settings: RenderSettings,
    has_own_lights: bool,
    /// The last picture, on either.
    pixels: Rc<RefCell<Vec<u32>>>,
    /// Exact first hits, to judge others by.
    exact: Vec<FirstHit>,
    level: Option<Level>,
}

impl From<TracerError> for Failure {
    fn from(error: TracerError) -> Failure {
        match error {
            TracerError::Build(error) => error.into(),
            TracerError::Scene(error) => error.into(),
            #[cfg(feature = "gpu")]
            TracerError::Render(splitplane::render::RenderError::Gpu(error)) => error.into(),
            error => Failure::new("query", error.to_string()),
        }
    }
}

impl Page {
    fn of(scene: Scene) -> Page {
        Page {
            has_own_lights: scene.is_lit(),
            scene: Rc::new(scene),
            tracer: None,
            #[cfg(feature = "gpu")]
            on_gpu: Rc::default(),
            orbit: None,
            settings: RenderSettings::default(),
            pixels: Rc::default(),
            exact: Vec::new(),
            level: None,
        }
    }

    fn ready(&mut self) -> Result<(&Scene, &mut Tracer, &mut Orbit), Failure> {
        match (&mut self.tracer, &mut self.orbit) {
            (Some(tracer), Some(orbit)) => Ok((&self.scene, tracer, orbit)),
            _ => Err(Failure::new("stale", "the scene has no tree yet")),
        }
    }
}

#[wasm_bindgen]
impl Page {
    /// The built-in scenes: names and what they show, in turn.
    #[wasm_bindgen(js_name = builtinScenes)]
    pub fn builtin_scenes() -> Vec<String> {
        let both = |(name, shows): &(&str, &str)| [(*name).to_owned(), (*shows).to_owned()];
        builtin::ALL.iter().flat_map(both).collect()
    }

    /// The most bytes of a file that are read.
    #[wasm_bindgen(js_name = mostBytes)]
    pub fn most_bytes() -> u32 {
        MOST_BYTES
    }

    /// The most boxes of a depth that are drawn.
    #[wasm_bindgen(js_name = mostBoxes)]
    pub fn most_boxes() -> usize {
        boxes::MOST
    }

    /// A built-in scene.
    pub fn builtin(name: &str) -> Result<Page, JsValue> {
        let scene = builtin::open(name);
        Ok(Page::of(scene.map_err(|error| Failure::new("file", error.to_string()))?))
    }

    /// The scene of a glTF, OBJ, PLY or STL file, `length` bytes from the start of `file`, by the ending of its name. Files that it names are not
    /// read: materials of OBJ files are clay, and a .gltf file has its buffers and pictures inside.
    pub fn read(file: &Words, length: u32, name: &str) -> Result<Page, JsValue> {
        let bytes = file.bytes().get(..length as usize);
        let bytes = bytes.ok_or_else(|| Failure::range("file", 0, length, file.bytes().len()))?;
        if length > MOST_BYTES {
            let text =
                format!("the file has {length} bytes, and {MOST_BYTES} are the most that are read");
            return Err(Failure::new("file", text).into());
        }
        Ok(Page::of(files::scene(bytes, name)?))
    }

    /// How many triangles.
    pub fn triangles(&self) -> usize {
        self.scene.indices.len()
    }

    /// What reading left out or found odd, as sentences.
    pub fn notes(&self) -> Vec<String> {
        self.scene.notes.sentences()
    }

    /// Builds the tree, and places a camera and lights where the scene has none. `aspect` is width over height.
    pub fn build(
        &mut self,
        preset: &str,
        aspect: f64,
        called: Option<Function>,
    ) -> Result<(), JsValue> {
        let options = build_options(preset, "fast", None)?;
        (self.level, self.exact) = (None, Vec::new());
        let kept = self.tracer.take();
        let scene = &self.scene;
        let mesh = scene.mesh().map_err(Failure::from)?;
        let mut tracer = watched(called, |watch| {
            let options = BuildOptions { watch, ..options };
            // The old tree goes before the new one comes.
            drop(kept);
            Tracer::load(CpuBackend::new(), &mesh, &scene.appearance(), &options)
        })
        .map_err(Failure::from)?;
        if self.orbit.is_none() {
            let accelerator =
                tracer.accelerator().ok_or_else(|| Failure::new("build", "no tree"))?;
            let placed = Placement::of(scene, accelerator, aspect).map_err(Failure::from)?;
            if !self.has_own_lights {
                self.settings.headlight = RenderSettings::PLACED_HEADLIGHT;
            }
            if placed.inside {
                self.settings.ambient = RenderSettings::INSIDE_AMBIENT;
            }
            let orbit = Orbit::new(placed.camera, placed.view == View::Inside, accelerator);
            self.orbit = Some(orbit);
            Rc::make_mut(&mut self.scene).lights = placed.lights;
        }
        let mesh = self.scene.mesh().map_err(Failure::from)?;
        tracer.update_appearance(&mesh, &self.scene.appearance()).map_err(Failure::from)?;
        self.tracer = Some(tracer);
        Ok(())
    }

    /// The tree's digest, 16 hexadecimal digits.
    pub fn digest(&mut self) -> Result<String, JsValue> {
        let (_, tracer, _) = self.ready()?;
        Ok(tracer.digest().map_err(Failure::from)?.to_string())
    }

    /// Nodes, references, bytes of queries, and the depth of the deepest node.
    pub fn size(&mut self) -> Result<Vec<f64>, JsValue> {
        let (_, tracer, _) = self.ready()?;
        let tree = tracer.accelerator().ok_or_else(|| Failure::new("build", "no tree"))?;
        let mut deepest = 0;
        tree.tree().view().walk(|_, _, _, depth| deepest = deepest.max(depth));
        let (nodes, references) = (tree.tree().nodes.len(), tree.tree().references.len());
        let bytes = tree.query_bytes();
        Ok(vec![nodes as f64, references as f64, bytes as f64, f64::from(deepest)])
    }

    /// Turns the camera about the middle of the picture, by parts of its height.
    pub fn turn(&mut self, right: f64, down: f64) -> Result<(), JsValue> {
        self.ready()?.2.turn(right, down);
        Ok(())
    }

    /// Comes nearer by steps of an eighth.
    pub fn zoom(&mut self, steps: f64) -> Result<(), JsValue> {
        self.ready()?.2.zoom(steps);
        Ok(())
    }

    /// Back to where the camera was first.
    pub fn home(&mut self) -> Result<(), JsValue> {
        self.ready()?.2.home();
        Ok(())
    }

    /// Makes a picture; [`Page::pixels`] has it. `numbers` are those of [`Wanted`].
    pub fn frame(&mut self, numbers: &[u32]) -> Result<Told, JsValue> {
        let wanted = Wanted::of(numbers)?;
        let settings = wanted.settings(self.settings);
        let pixels = Rc::clone(&self.pixels);
        let (scene, tracer, orbit) = self.ready()?;
        let request = wanted.request(settings, orbit.camera());
        let mesh = scene.mesh().map_err(Failure::from)?;
        tracer.update_appearance(&mesh, &wanted.appearance(scene)).map_err(Failure::from)?;
        let frame = tracer.frame(&mesh, &request).map_err(Failure::from)?;
        Ok(picture::take(&frame, &wanted, &pixels)?)
    }

    /// Where the last picture is in the module's memory: a word a pixel, red in the lowest byte, row by row from the top left.
    pub fn pixels(&self) -> usize {
        self.pixels.borrow().as_ptr() as usize
    }

    /// How many pixels it has.
    pub fn count(&self) -> usize {
        self.pixels.borrow().len()
    }

    /// The boxes of the tree's nodes at a depth, in a picture of this size: five floats an edge, both ends in pixels, and 0 for a box of more
    /// nodes, 1 for a leaf and 2 for an empty one. Of very many boxes the largest are shown; the first number is how many there are.
    pub fn boxes(&mut self, depth: u32, width: u32, height: u32) -> Result<Vec<f32>, JsValue> {
        let size = picture::size(width, height)?;
        let known = self.level.take().filter(|level| level.depth() == depth);
        let (_, tracer, orbit) = self.ready()?;
        let tree = tracer.accelerator().ok_or_else(|| Failure::new("build", "no tree"))?;
        let level = known.unwrap_or_else(|| Level::of(&tree.tree().view(), depth));
        let edges = level.edges(&orbit.camera().pinhole(size), size);
        self.level = Some(level);
        Ok(edges)
    }

    /// Traces the first ray of each pixel by an accuracy, and judges it by what `exact` found, which comes first: the numbers of rays, of those
    /// that find another triangle, and of those that find nothing where there is something.
    pub fn judge(&mut self, width: u32, height: u32, test: u32) -> Result<Vec<f64>, JsValue> {
        let size = picture::size(width, height)?;
        let settings = self.settings;
        let mut exact = std::mem::take(&mut self.exact);
        let (scene, tracer, orbit) = self.ready()?;
        let request = judge::request(settings, orbit.camera(), size, test)?;
        let mesh = scene.mesh().map_err(Failure::from)?;
        let frame = tracer.frame(&mesh, &request).map_err(Failure::from)?;
        let hits = frame.first_hits().map_err(Failure::from)?;
        if test == judge::EXACT {
            exact = hits.into_owned();
            self.exact = exact;
            return Ok(vec![self.exact.len() as f64, 0.0, 0.0]);
        }
        let told = judge::judge(&hits, &exact)?;
        drop(hits);
        self.exact = exact;
        Ok(told)
    }
}
