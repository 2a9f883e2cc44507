//! What the demonstration page calls, in a worker: a scene, its tree, and pictures of it.

mod heat;
mod orbit;

use js_sys::Function;
use splitplane::render::{Outputs, RenderSettings, Size};
use splitplane::scene::{Placement, Scene, View, builtin, obj};
use splitplane::tracer::{FrameRequest, Tracer, TracerError};
use splitplane::{BuildOptions, CpuBackend, QueryOptions};
use splitplane_scene::ply;
use std::path::Path;
use wasm_bindgen::prelude::*;

use crate::failure::Failure;
use crate::named::{accuracy, build_options};
use crate::progress::watched;
use crate::words::{Words, zeros};
use orbit::Orbit;

/// Most bytes of a file that is read: what is made of them takes several times as many, of the 4 GiB that a module can have.
const MOST_BYTES: u32 = 384 << 20;

/// A scene whose tree is built.
#[wasm_bindgen]
pub struct Page {
    scene: Scene,
    tracer: Option<Tracer>,
    orbit: Option<Orbit>,
    settings: RenderSettings,
    has_own_lights: bool,
    pixels: Vec<u32>,
}

/// What a frame took, in counts.
#[wasm_bindgen]
#[derive(Clone, Copy)]
pub struct Told {
    /// Camera, reflected and refracted rays.
    pub paths: f64,
    /// Rays towards lights.
    pub shadows: f64,
    /// Of a heat map the cost of the brightest colour, else 0.
    pub top: f64,
}

impl From<TracerError> for Failure {
    fn from(error: TracerError) -> Failure {
        match error {
            TracerError::Build(error) => error.into(),
            TracerError::Scene(error) => error.into(),
            error => Failure::new("query", error.to_string()),
        }
    }
}

fn scene(bytes: &[u8], name: &str) -> Result<Scene, Failure> {
    let path = Path::new(name);
    let ending = path.extension().unwrap_or_default();
    if ending.eq_ignore_ascii_case("ply") {
        return ply::parse(bytes, path).map_err(|error| Failure::new("file", error.to_string()));
    }
    if !ending.eq_ignore_ascii_case("obj") {
        let text = format!("the page reads .obj and .ply files, and `{name}` is neither");
        return Err(Failure::new("file", text));
    }
    let text = std::str::from_utf8(bytes)
        .map_err(|error| Failure::new("file", format!("the file is no text: {error}")))?;
    obj::parse(text, name).map_err(|error| Failure::new("file", error.to_string()))
}

impl Page {
    fn of(scene: Scene) -> Page {
        let has_own_lights = scene.is_lit();
        let settings = RenderSettings::default();
        Page { scene, tracer: None, orbit: None, settings, has_own_lights, pixels: Vec::new() }
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

    /// A built-in scene.
    pub fn builtin(name: &str) -> Result<Page, JsValue> {
        let scene = builtin::open(name);
        Ok(Page::of(scene.map_err(|error| Failure::new("file", error.to_string()))?))
    }

    /// The scene of an OBJ or PLY file, `length` bytes from the start of `file`, by the ending of its name. Materials are clay: files that an
    /// OBJ file names are not read.
    pub fn read(file: &Words, length: u32, name: &str) -> Result<Page, JsValue> {
        let bytes = file.bytes().get(..length as usize);
        let bytes = bytes.ok_or_else(|| Failure::range("file", 0, length, file.bytes().len()))?;
        if length > MOST_BYTES {
            let text =
                format!("the file has {length} bytes, and {MOST_BYTES} are the most that are read");
            return Err(Failure::new("file", text).into());
        }
        Ok(Page::of(scene(bytes, name)?))
    }

    /// How many triangles.
    pub fn triangles(&self) -> usize {
        self.scene.indices.len()
    }

    /// The scene's vertices, three floats each: a copy.
    pub fn positions(&self) -> Result<Words, JsValue> {
        let from: &[u32] = bytemuck::cast_slice(&self.scene.positions);
        let mut words = zeros(from.len())?;
        words.copy_from_slice(from);
        Ok(Words::of(words))
    }

    /// The scene's triangles, three indices each: a copy.
    pub fn indices(&self) -> Result<Words, JsValue> {
        let from = self.scene.indices.as_flattened();
        let mut words = zeros(from.len())?;
        words.copy_from_slice(from);
        Ok(Words::of(words))
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
        let (scene, kept) = (&mut self.scene, self.tracer.take());
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
            scene.lights.clone_from(&placed.lights);
            if !self.has_own_lights {
                self.settings.headlight = RenderSettings::PLACED_HEADLIGHT;
            }
            if placed.inside {
                self.settings.ambient = RenderSettings::INSIDE_AMBIENT;
            }
            let orbit = Orbit::new(placed.camera, placed.view == View::Inside, accelerator);
            self.orbit = Some(orbit);
        }
        let mesh = scene.mesh().map_err(Failure::from)?;
        tracer.update_appearance(&mesh, &scene.appearance()).map_err(Failure::from)?;
        self.tracer = Some(tracer);
        Ok(())
    }

    /// The tree's digest, 16 hexadecimal digits.
    pub fn digest(&mut self) -> Result<String, JsValue> {
        let (_, tracer, _) = self.ready()?;
        Ok(tracer.digest().map_err(Failure::from)?.to_string())
    }

    /// Nodes, references, and bytes of queries.
    pub fn size(&mut self) -> Result<Vec<f64>, JsValue> {
        let (_, tracer, _) = self.ready()?;
        let tree = tracer.accelerator().ok_or_else(|| Failure::new("build", "no tree"))?;
        let (nodes, references) = (tree.tree().nodes.len(), tree.tree().references.len());
        Ok(vec![nodes as f64, references as f64, tree.query_bytes() as f64])
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

    /// Makes a picture; [`Page::pixels`] has it. `view` is 0 for light, 1 for what the first ray of each pixel cost. Without `lights` no
    /// light casts shadows, and a lamp at the eye shines instead.
    #[expect(clippy::too_many_arguments, reason = "what JavaScript hands over, one by one")]
    pub fn frame(
        &mut self,
        width: u32,
        height: u32,
        samples: u32,
        depth: u32,
        test: u32,
        lights: bool,
        view: u32,
    ) -> Result<Told, JsValue> {
        let size = Size::new(width, height);
        let size = size.map_err(|error| Failure::new("config", error.to_string()))?;
        let mut settings = RenderSettings { samples, depth, ..self.settings };
        if !lights {
            (settings.area_samples, settings.headlight) = (0, 1.0);
        }
        let costs = view == 1;
        let (scene, tracer, orbit) = self.ready()?;
        let unlit = splitplane::render::Appearance { lights: &[], ..scene.appearance() };
        let appearance = if lights { scene.appearance() } else { unlit };
        let mesh = scene.mesh().map_err(Failure::from)?;
        tracer.update_appearance(&mesh, &appearance).map_err(Failure::from)?;
        let query = QueryOptions { accuracy: accuracy(test)?, ..QueryOptions::default() };
        let none = Outputs { pixels: false, radiance: false, first_hits: false, first_costs: true };
        let outputs = if costs { none } else { Outputs::PIXELS };
        let request = FrameRequest {
            settings,
            outputs,
            query,
            ..FrameRequest::new(orbit.camera().pinhole(size), size)
        };
        let frame = tracer.frame(&mesh, &request).map_err(Failure::from)?;
        let mut told = Told {
            paths: frame.stats().paths as f64,
            shadows: frame.stats().shadow_rays as f64,
            top: 0.0,
        };
        let count = size.pixels() as usize;
        let mut pixels: Vec<u32> = zeros(count)?;
        if costs {
            let costs = frame.first_costs().map_err(Failure::from)?;
            told.top = heat::paint(&costs, &mut pixels);
        } else {
            pixels.copy_from_slice(&frame.pixels().map_err(Failure::from)?);
        }
        self.pixels = pixels;
        Ok(told)
    }

    /// Where the last picture is in the module's memory: a word a pixel, red in the lowest byte, row by row from the top left.
    pub fn pixels(&self) -> usize {
        self.pixels.as_ptr() as usize
    }

    /// How many pixels it has.
    pub fn count(&self) -> usize {
        self.pixels.len()
    }
}
