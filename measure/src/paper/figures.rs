//! Which figures a report has, and of which scenes.

use super::file::File;
use super::motion::Motion;
use super::objects::{self, Objects};
use super::plot::{Plot, ScalingPlot, png, svg};
use super::scaling::Scaling;
use super::scene::{Placed, Settings};
use super::timing::pool;
use super::{ReportError, areas, cells, crown, cut, point_trees, slice};
use serde::Serialize;
use splitplane::picture::{encode_png, screen};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane_core::config::Preset;
use splitplane_core::ray::QueryOptions;
use splitplane_core::tree::KdTree;
use splitplane_cpu::CpuBackend;
use splitplane_render::{Outputs, RenderSettings};

/// A figure in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Its number in the survey; 0 for the picture that goes with Table 4.
    pub number: u32,
    /// Its files, the one that is shown first.
    pub files: Vec<String>,
    /// What it shows.
    pub caption: String,
}

/// Figures with their files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// In words.
    pub list: Vec<Figure>,
    /// As bytes.
    pub files: Vec<File>,
}

impl Figures {
    /// Draws a figure as PNG and SVG.
    fn draw<P: Plot>(
        &mut self,
        number: u32,
        name: &str,
        caption: String,
        plot: &P,
    ) -> Result<(), ReportError> {
        let names = [format!("{name}.png"), format!("{name}.svg")];
        self.files.push(File { name: names[0].clone(), bytes: png(plot)? });
        self.files.push(File { name: names[1].clone(), bytes: svg(plot)?.into_bytes() });
        self.list.push(Figure { number, files: names.to_vec(), caption });
        Ok(())
    }

    /// Table 4: of the scene in which the refitted hierarchy decays most.
    ///
    /// # Errors
    /// [`ReportError::Picture`].
    pub fn motion(&mut self, motions: &[Motion]) -> Result<(), ReportError> {
        let worst = |motion: &Motion| motion.decay().map_or(0.0, |[_, worst]| worst);
        let Some(motion) = motions.iter().max_by(|a, b| worst(a).total_cmp(&worst(b))) else {
            return Ok(());
        };
        let caption = format!(
            "What the rays of each frame of `{}` take, {}. The refitted hierarchy keeps the shape of the first frame; the other two \
             structures are built for each.",
            motion.scene, motion.moves
        );
        self.draw(0, "table-4", caption, motion)
    }

    /// Figure 7.
    ///
    /// # Errors
    /// [`ReportError::Picture`].
    pub fn areas(&mut self, scene: &str, areas: &areas::Areas) -> Result<(), ReportError> {
        let caption = format!(
            "Lines that meet a box against its surface area, among {} lines distributed evenly over \
             all that meet the sphere around `{scene}`, counted by any-hit queries. Fitted: {:.1} \
             area {:+.1}, R² = {:.6}. Integral geometry (Crofton) gives {:.0} area.",
            areas.lines,
            areas.slope,
            areas.intercept,
            areas.r_squared,
            areas.expected_slope()
        );
        self.draw(7, "figure-7", caption, areas)
    }

    /// Figures 4, 8 and 9: of the scene whose slice shows most cells.
    ///
    /// # Errors
    /// [`ReportError::Picture`].
    pub fn tree(&mut self, scenes: &[Placed], trees: &[KdTree]) -> Result<(), ReportError> {
        let slices = scenes.iter().zip(trees).map(|(placed, tree)| {
            (&placed.scene, tree.view(), slice::take(&tree.view(), &placed.scene))
        });
        let Some((scene, view, slice)) = slices.max_by_key(|(_, _, slice)| slice.cells.len())
        else {
            return Ok(());
        };
        let caption = format!(
            "The tree of `{}` by preset fast as boxes: the cells that a plane through the scene meets, \
             down to level {}. White cells are empty.",
            scene.name, slice.level
        );
        self.draw(4, "figure-4", caption, &slice)?;
        let crown = crown::of(&view);
        let caption = format!(
            "The same tree as a diagram, to level {}. The survey's own tree of seven nodes is in Tables 1 and 2; its axes take turns by level, which \
             builders by SAH or by medians of the longest side do not do: a node is split where it costs least, on any axis.",
            crown.levels
        );
        self.draw(8, "figure-8", caption, &crown)?;
        let (space, level) = cells::figure_9(&view, &scene.name);
        let caption = format!(
            "Cells in space, seen from the corner of greatest x, y and z, drawn apart: the four leaves of the survey's \
             Figure 8 with their names, and the nodes of the tree of `{}` at level {level} with the leaves above. Red and blue are \
             in the left child of the root, yellow and green in the right one; cells without triangles are frames.",
            scene.name
        );
        self.draw(9, "figure-9", caption, &space)
    }

    /// Figures 3, 4, 8 and 9 as the survey has them: of trees of points.
    ///
    /// # Errors
    /// [`ReportError::Picture`], or no memory.
    pub fn point_trees(&mut self) -> Result<(), ReportError> {
        let (diagram, plane) = point_trees::figures_3_and_4()?;
        let caption = format!(
            "A tree of {} points of the plane (`PointTree`, axes by cycle): the root is divided across x, its children across y, theirs across x \
             again. Points stand in blocks of 16, not in nodes as the survey's do.",
            plane.points.len()
        );
        self.draw(3, "figure-3", caption, &diagram)?;
        let caption =
            "The tree of Figure 3 in the plane: each plane ends where one above it stands.";
        self.draw(4, "figure-4-points", caption.into(), &plane)?;
        let (diagram, space) = point_trees::figures_8_and_9()?;
        let caption = "The survey's tree from points: a cloud in which its seven points are the first beyond each plane. Axes take turns, x, y, z, \
                       and each node divides at the coordinate of the point that the survey has there.";
        self.draw(8, "figure-8-points", caption.into(), &diagram)?;
        let caption = "Cells of that tree, drawn apart, seen from the corner of greatest x, y and z: the four of the survey's figure, and what the \
                       planes across z make of them.";
        self.draw(9, "figure-9-points", caption.into(), &space)
    }

    /// Figures 5 and 6: of the scene whose objects have most triangles. Gives what they show.
    ///
    /// # Errors
    /// [`ReportError::Picture`].
    pub fn objects(
        &mut self,
        scenes: &[Placed],
        trees: &[KdTree],
    ) -> Result<Option<Objects>, ReportError> {
        let found = scenes
            .iter()
            .zip(trees)
            .filter_map(|(placed, tree)| objects::find(&tree.view(), &placed.scene));
        let Some(objects) = found.max_by_key(|objects| objects.triangles(1)[0]) else {
            return Ok(None);
        };
        let [all, met] = objects.triangles(1);
        let caption = format!(
            "Two objects of `{}`, the triangles under the children of node {}, in their boxes. The line meets one box \
             (`Aabb::ray_interval`), so its {met} triangles are to be tested; the other {} are not.",
            objects.scene,
            objects.node,
            all - met
        );
        self.draw(5, "figure-5", caption, &objects.figure_5())?;
        let [_, parts] = objects.triangles(2);
        let caption = format!(
            "The same objects with the boxes of the tree's next level within. The line meets boxes of {parts} of these {all} triangles \
             there, each counted once."
        );
        self.draw(6, "figure-6", caption, &objects.figure_6())?;
        Ok(Some(objects))
    }

    /// Figure 10: of the scene whose tree shows most.
    ///
    /// # Errors
    /// [`ReportError::Picture`].
    pub fn cut(&mut self, scenes: &[Placed], trees: &[KdTree]) -> Result<(), ReportError> {
        let mut best: Option<(&str, cut::Cut)> = None;
        for (placed, tree) in scenes.iter().zip(trees) {
            let Some(cut) = cut::find(&tree.view(), &placed.scene) else { continue };
            let shown = |cut: &cut::Cut| {
                cut.cuts.iter().filter(|plane| cut.axes.contains(&plane.axis)).count()
            };
            if best.as_ref().is_none_or(|(_, other)| shown(&cut) > shown(other)) {
                best = Some((&placed.scene.name, cut));
            }
        }
        // Scenes so small that nothing was cut have no such figure.
        let Some((scene, cut)) = best else { return Ok(()) };
        let caption = format!(
            "Empty-space cutting and median split of a node of `{scene}`: {} of more than a quarter of \
             its cell, then the spatial median of what is left. Cell, planes and triangles are those of \
             the tree.",
            match cut.cuts.len() {
                1 => "one cut".to_owned(),
                count => format!("{count} cuts, each"),
            }
        );
        self.draw(10, "figure-10", caption, &cut)
    }

    /// Figure 11: a picture of each scene.
    ///
    /// # Errors
    /// A frame that cannot be made.
    pub fn picture(
        &mut self,
        letter: char,
        placed: &Placed,
        samples: u32,
        settings: &Settings,
    ) -> Result<(), ReportError> {
        let scene = &placed.scene;
        let mesh = scene.mesh()?;
        let image = pool(settings.threads)?.install(|| {
            let options = settings.build(Preset::Fast);
            let mut tracer = Tracer::load(CpuBackend::new(), &mesh, &scene.appearance(), &options)?;
            let request = FrameRequest {
                camera: placed.camera.pinhole(settings.size),
                size: settings.size,
                settings: placed.settings(samples, RenderSettings::default().depth),
                outputs: Outputs::PIXELS,
                query: QueryOptions::default(),
            };
            let frame = tracer.frame(&mesh, &request)?;
            Ok::<_, ReportError>(screen(settings.size, &frame.pixels()?)?)
        })?;
        let name = format!("figure-11-{letter}.png");
        self.files.push(File { name: name.clone(), bytes: encode_png(&image)? });
        let lights = scene.lights.len();
        let caption = format!(
            "({letter}) `{}`, {} triangles, {lights} light{}.",
            scene.name,
            scene.indices.len(),
            if lights == 1 { "" } else { "s" }
        );
        self.list.push(Figure { number: 11, files: vec![name], caption });
        Ok(())
    }

    /// Figure 12: scalings on one backend.
    ///
    /// # Errors
    /// [`ReportError::Picture`].
    pub fn scaling(&mut self, name: &str, scalings: &[Scaling]) -> Result<(), ReportError> {
        let device = scalings.first().is_some_and(|scaling| scaling.backend != "cpu");
        let processors = match device {
            true => "workgroups of a dispatch, the GPU's share of processors",
            false => "threads",
        };
        let caption = format!(
            "Build time by preset fast against the number of {processors}, for the smallest and the \
             largest scene. Dashed: the greatest speed-ups that the survey prints for its own, 3 (toys) \
             and 6 (dragon), whatever their numbers of processors.{}",
            match scalings.iter().any(|scaling| scaling.software) {
                true =>
                    " The adapter is software, whose workgroups are the CPU's threads: its curve means nothing.",
                false => "",
            }
        );
        self.draw(12, name, caption, &ScalingPlot(scalings))
    }
}

/// The tree of a scene by preset `fast`, on the CPU.
///
/// # Errors
/// A tree that cannot be built.
pub fn tree(placed: &Placed, settings: &Settings) -> Result<KdTree, ReportError> {
    let mesh = placed.scene.mesh()?;
    let options = settings.build(Preset::Fast);
    let built = pool(settings.threads)?.install(|| CpuBackend::new().build_tree(&mesh, &options));
    Ok(built?.0)
}
