//! The photons of a pass, in trees of points.

use super::bounce::{Map, Photon};
use super::density::{Disks, irradiance};
use super::tree::{PhotonTree, PointTrees};
use crate::error::RenderError;
use crate::layout::{Frame, Path, Surface};
use crate::vector::{Vector, add, mul};
use rayon::prelude::*;
use splitplane_core::points::build::PointOptions;
use splitplane_core::points::nearest::Neighbour;
use splitplane_core::watch::Watch;
use splitplane_float_state::Standard;

/// Photons as they are stored, before their tree is built.
#[derive(Debug, Default)]
pub(super) struct Stored {
    pub(super) places: Vec<Vector>,
    pub(super) photons: Vec<Photon>,
}

/// The maps of a pass; those without photons are missing.
#[derive(Debug)]
pub(crate) struct Maps {
    maps: [Option<(PhotonTree, Vec<Photon>)>; 2],
    disks: Disks,
    neighbours: usize,
}

impl Maps {
    /// Builds the trees.
    ///
    /// # Errors
    /// More bytes than allowed, a watch that cancels, or a device that fails.
    pub(super) fn new(
        trees: &PointTrees,
        stored: [Stored; 2],
        disks: Disks,
        neighbours: u32,
        (limit, watch): (u64, Option<&dyn Watch>),
    ) -> Result<Maps, RenderError> {
        let options = PointOptions { max_memory: Some(limit), watch, ..PointOptions::default() };
        let build = |Stored { places, photons }: Stored| -> Result<_, RenderError> {
            if photons.is_empty() {
                return Ok(None);
            }
            Ok(Some((trees.build(&places, &options)?, photons)))
        };
        let [caustics, global] = stored;
        let maps = [build(caustics)?, build(global)?];
        Ok(Maps { maps, disks, neighbours: neighbours as usize })
    }

    /// Adds the light of photons to that of the surfaces that ask for it.
    ///
    /// # Errors
    /// A watch that cancels, no memory, or a device that fails.
    pub(crate) fn light(
        &self,
        frame: &Frame,
        paths: &[Path],
        surfaces: &mut [Surface],
        watch: Option<&dyn Watch>,
    ) -> Result<(), RenderError> {
        let flags = [(Map::Caustics, Surface::CAUSTICS), (Map::Global, Surface::GLOBAL)];
        let (mut asking, mut queries) = (Vec::new(), Vec::new());
        let mut found = Vec::new();
        for (map, flag) in flags {
            let Some((tree, photons)) = &self.maps[map as usize] else { continue };
            asking.clear();
            let asks = |(_, surface): &(usize, &Surface)| surface.flags & flag != 0;
            asking.extend(surfaces.iter().enumerate().filter(asks).map(|(place, _)| place as u32));
            for some in asking.chunks(tree.queries(self.neighbours)) {
                queries.clear();
                queries.extend(some.iter().map(|&place| surfaces[place as usize].point));
                found.resize(some.len() * self.neighbours, Neighbour::NONE);
                tree.nearest(&queries, &mut found, (self.neighbours, self.disks, watch))?;
                let lit: Vec<Vector> = some
                    .par_iter()
                    .zip(found.par_chunks(self.neighbours))
                    .with_min_len(64)
                    .map(|(&place, found)| {
                        let _state = Standard::set();
                        let (path, surface) = (&paths[place as usize], &surfaces[place as usize]);
                        let light = irradiance(frame, surface, photons, found, self.disks);
                        mul(mul(path.weight, surface.scattering), light)
                    })
                    .collect();
                for (&place, light) in some.iter().zip(lit) {
                    let surface = &mut surfaces[place as usize];
                    surface.light = add(surface.light, light);
                }
            }
        }
        Ok(())
    }
}
