//! The tree of a map's photons: built and asked on the cores of this machine, or on a device. Its answers are the same, bit for bit.

use super::density::Disks;
use crate::vector::Vector;
#[cfg(feature = "wgpu")]
use splitplane_core::error::DeviceError;
use splitplane_core::error::QueryError;
use splitplane_core::points::build::{PointBuildError, PointOptions};
use splitplane_core::points::nearest::{NearestOptions, Neighbour};
use splitplane_core::watch::Watch;
use splitplane_cpu::CpuPointTree;
#[cfg(feature = "wgpu")]
use splitplane_wgpu::{Queries, WgpuPointTree};
#[cfg(feature = "wgpu")]
use std::sync::Arc;

/// What builds the trees of photons, and answers them.
#[derive(Clone, Debug, Default)]
pub(crate) enum PointTrees {
    /// The cores of this machine.
    #[default]
    Cpu,
    /// A device.
    #[cfg(feature = "wgpu")]
    Device(Arc<Queries>),
}

impl PointTrees {
    pub(super) fn build(
        &self,
        places: &[Vector],
        options: &PointOptions<'_>,
    ) -> Result<PhotonTree, PointBuildError> {
        match self {
            PointTrees::Cpu => Ok(PhotonTree::Cpu(CpuPointTree::build(places, options)?)),
            #[cfg(feature = "wgpu")]
            PointTrees::Device(queries) => {
                let on_cpu = || Ok(PhotonTree::Cpu(CpuPointTree::build(places, options)?));
                if !queries.is_certain() {
                    return on_cpu();
                }
                match WgpuPointTree::build(Arc::clone(queries), places, options) {
                    Ok(tree) => Ok(PhotonTree::Device(tree)),
                    // More photons than the device has room for. The tree of the CPU has the same answers.
                    Err(PointBuildError::Device(
                        DeviceError::Limit { .. } | DeviceError::OutOfMemory { .. },
                    )) => on_cpu(),
                    Err(error) => Err(error),
                }
            }
        }
    }
}

/// A tree of photons.
#[derive(Debug)]
pub(super) enum PhotonTree {
    Cpu(CpuPointTree<3>),
    #[cfg(feature = "wgpu")]
    Device(WgpuPointTree<3>),
}

/// Surfaces that look up photons at a time on the cores of this machine.
const QUERIES: usize = 1 << 13;
/// Most of them on a device: a batch has to go there and back.
#[cfg(feature = "wgpu")]
const DEVICE_QUERIES: usize = 1 << 16;
/// Bytes of their answers beyond which there are no more than [`QUERIES`].
const BATCH_BYTES: usize = 64 << 20;

impl PhotonTree {
    /// How many surfaces look up so many photons at a time. Answers do not depend on it.
    pub(super) fn queries(&self, neighbours: usize) -> usize {
        let most = match self {
            PhotonTree::Cpu(_) => QUERIES,
            #[cfg(feature = "wgpu")]
            PhotonTree::Device(_) => DEVICE_QUERIES,
        };
        let fit = BATCH_BYTES / (neighbours * size_of::<Neighbour>()).max(1);
        fit.clamp(QUERIES, most)
    }

    /// The nearest photons of each point, as many as there is room for, within the reach of the disks.
    pub(super) fn nearest(
        &self,
        points: &[Vector],
        found: &mut [Neighbour],
        (neighbours, disks, watch): (usize, Disks, Option<&dyn Watch>),
    ) -> Result<(), QueryError> {
        let options = NearestOptions {
            k: neighbours,
            max_distance: disks.reach,
            watch,
            ..NearestOptions::default()
        };
        match self {
            PhotonTree::Cpu(tree) => tree.nearest(points, found, &options),
            #[cfg(feature = "wgpu")]
            PhotonTree::Device(tree) => tree.nearest(points, found, &options).map(|_| ()),
        }
    }
}
