//! Animation of nodes: where their instances are in frames.

use super::buffers::Buffers;
use super::nodes::{Found, Local, unit};
use super::{MISSING, wrong};
use crate::instanced::{InstancedScene, Key, Pose};
use crate::mesh_file::Located;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use gltf_json::Root;
use gltf_json::accessor::Type;
use gltf_json::animation::{Interpolation, Property};
use gltf_json::validation::Checked;
use splitplane_core::scene::ObjectSpace;

/// Frames a second.
pub(super) const RATE: f64 = 24.0;
/// Most frames, as in scene files.
const MOST_FRAMES: u32 = 1 << 20;
/// Most frames times nodes and channels: half a minute of a hundred thousand nodes.
const MOST: u64 = 1 << 26;
/// Most keys of all instances together.
const MOST_KEYS: u64 = 1 << 22;
/// By how much axes of a pose may lean on one another, as cosines.
const LEAN: f64 = 1e-4;

/// What a channel sets.
#[derive(Clone, Copy)]
enum Part {
    Translation,
    Rotation,
    Scale,
}

/// Values over time for a part of a node.
struct Track {
    /// The place of the node in the list.
    place: usize,
    part: Part,
    how: Interpolation,
    times: Vec<f64>,
    /// One for each time; three (tangent in, value, tangent out) for cubic splines.
    values: Vec<[f64; 4]>,
}

impl Track {
    /// The value at a time: the first before all times, and the last after them.
    fn at(&self, time: f64) -> [f64; 4] {
        let after = self.times.partition_point(|own| *own <= time);
        let value = |key: usize| match self.how {
            Interpolation::CubicSpline => self.values[3 * key + 1],
            _ => self.values[key],
        };
        if after == 0 {
            return value(0);
        }
        let before = after - 1;
        if after == self.times.len() || matches!(self.how, Interpolation::Step) {
            return value(before);
        }
        let length = self.times[after] - self.times[before];
        let t = (time - self.times[before]) / length;
        let (a, mut b) = (value(before), value(after));
        if let Interpolation::CubicSpline = self.how {
            let (out, into) = (self.values[3 * before + 2], self.values[3 * after]);
            let (t2, t3) = (t * t, t * t * t);
            return std::array::from_fn(|k| {
                (2.0 * t3 - 3.0 * t2 + 1.0) * a[k]
                    + (t3 - 2.0 * t2 + t) * length * out[k]
                    + (3.0 * t2 - 2.0 * t3) * b[k]
                    + (t3 - t2) * length * into[k]
            });
        }
        let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        if matches!(self.part, Part::Rotation) && dot < 0.0 {
            b = b.map(|part| -part);
        }
        std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t)
    }
}

/// Gives instances whose nodes move their keys.
pub(super) fn read(
    root: &Root,
    nodes: &[Found],
    places: &[usize],
    buffers: &mut Buffers<'_>,
    scene: &mut InstancedScene,
) -> Result<(), Located> {
    let more = root.animations.len().saturating_sub(1);
    if more > 0 {
        let note = format!("{more} animations are left out: the first one counts");
        scene.parts.notes.warnings.push(note);
    }
    let tracks = tracks(root, nodes, buffers, scene)?;
    // A node moves where it or one above it has a track.
    let mut moves = vec![false; nodes.len()];
    tracks.iter().for_each(|track| moves[track.place] = true);
    for place in 0..nodes.len() {
        moves[place] |= nodes[place].parent.is_some_and(|parent| moves[parent]);
    }
    let moving: Vec<usize> = (0..places.len()).filter(|own| moves[places[*own]]).collect();
    let end = tracks.iter().filter_map(|track| track.times.last()).fold(0.0, |a: f64, b| a.max(*b));
    let frames = (end * RATE).ceil() + 1.0;
    let most = MOST_KEYS / (moving.len() as u64).max(1);
    let work = (nodes.len() + tracks.len()) as u64;
    if moving.is_empty() || end <= 0.0 {
        return Ok(());
    }
    if frames > f64::from(MOST_FRAMES)
        || frames > most as f64
        || frames > (MOST / work.max(1)) as f64
    {
        let note = format!(
            "the animation is left out: {frames} frames of {} moving instances are too many",
            moving.len()
        );
        scene.parts.notes.warnings.push(note);
        return Ok(());
    }
    let frames = frames as u32;
    let mut keys: Vec<Option<Vec<Key>>> = moving.iter().map(|_| Some(Vec::new())).collect();
    let mut local: Vec<Local> = nodes.iter().map(|found| found.local).collect();
    let mut world = vec![DAffine3::IDENTITY; nodes.len()];
    for frame in 0..frames {
        let time = f64::from(frame) / RATE;
        for track in &tracks {
            set(&mut local[track.place], track.part, track.at(time));
        }
        for (place, found) in nodes.iter().enumerate() {
            let above = found.parent.map_or(DAffine3::IDENTITY, |parent| world[parent]);
            world[place] = above * local[place].map();
        }
        for (own, keys) in moving.iter().zip(&mut keys) {
            let pose = pose(&world[places[*own]]);
            match (pose, keys.as_mut()) {
                (Some(pose), Some(keys)) => keys.push(Key { frame, pose }),
                _ => *keys = None,
            }
        }
    }
    let mut still = 0u64;
    for (own, keys) in moving.iter().zip(keys) {
        match keys {
            Some(keys) => {
                let placed = &mut scene.instances[*own];
                placed.transform = keys[0].pose.transform();
                placed.keys = keys;
            }
            None => still += 1,
        }
    }
    scene.frames = frames;
    if still > 0 {
        scene.parts.notes.warnings.push(format!(
            "{still} instances stand still: in some frame their place is no move, turn and scales along their own axes"
        ));
    }
    Ok(())
}

fn set(local: &mut Local, part: Part, value: [f64; 4]) {
    let Local::Parts { translation, rotation, scale } = local else { return };
    let [x, y, z, _] = value;
    match part {
        Part::Translation => *translation = DVec3::new(x, y, z),
        Part::Rotation => *rotation = unit(value).unwrap_or(*rotation),
        Part::Scale => *scale = DVec3::new(x, y, z),
    }
}

/// The map as a pose, where it is one that has an inverse.
fn pose(map: &DAffine3) -> Option<Pose> {
    let axes = map.matrix3;
    let columns = [axes.x_axis, axes.y_axis, axes.z_axis];
    let mut scale = columns.map(DVec3::length);
    let is_finite = map.is_finite() && scale.iter().all(|factor| factor.is_finite());
    if !is_finite || scale.contains(&0.0) {
        return None;
    }
    // A reflection is one along the first axis in every frame, so that no scale passes 0 between two.
    if axes.determinant() < 0.0 {
        scale[0] = -scale[0];
    }
    let unit: [DVec3; 3] = std::array::from_fn(|k| columns[k] / scale[k]);
    let lean = |a: usize, b: usize| unit[a].dot(unit[b]).abs() > LEAN;
    if lean(0, 1) || lean(1, 2) || lean(0, 2) {
        return None;
    }
    let rotation = DQuat::from_mat3(&DMat3::from_cols(unit[0], unit[1], unit[2])).normalize();
    let pose = Pose { translate: map.translation.to_array(), rotate: rotation.to_array(), scale };
    ObjectSpace::new(&pose.transform()).map(|_| pose)
}

/// The channels of the first animation that set places of nodes of the scene.
fn tracks(
    root: &Root,
    nodes: &[Found],
    buffers: &mut Buffers<'_>,
    scene: &mut InstancedScene,
) -> Result<Vec<Track>, Located> {
    let mut tracks = Vec::new();
    let Some(animation) = root.animations.first() else { return Ok(tracks) };
    let mut place_of = vec![None; root.nodes.len()];
    for (place, found) in nodes.iter().enumerate() {
        place_of[found.node] = Some(place);
    }
    let (mut weights, mut fixed) = (0u64, 0u64);
    for (index, channel) in animation.channels.iter().enumerate() {
        let field = || format!("animations[0].channels[{index}]");
        let Some(place) = place_of.get(channel.target.node.value()) else {
            return Err(wrong(format!("{}.target.node", field()), MISSING));
        };
        // Nodes of other scenes.
        let Some(place) = *place else { continue };
        let part = match channel.target.path {
            Checked::Valid(Property::Translation) => Part::Translation,
            Checked::Valid(Property::Rotation) => Part::Rotation,
            Checked::Valid(Property::Scale) => Part::Scale,
            _ => {
                weights += 1;
                continue;
            }
        };
        if let Local::Matrix(_) = nodes[place].local {
            fixed += 1;
            continue;
        }
        let Some(sampler) = animation.samplers.get(channel.sampler.value()) else {
            return Err(wrong(field(), MISSING));
        };
        let Checked::Valid(how) = sampler.interpolation else {
            return Err(wrong(field(), "the interpolation is not one of the format"));
        };
        let times = buffers.numbers::<1>(sampler.input, Type::Scalar)?;
        let times: Vec<f64> = times.iter().map(|[time]| f64::from(*time)).collect();
        let values: Vec<[f64; 4]> = match part {
            Part::Rotation => {
                let own = buffers.numbers::<4>(sampler.output, Type::Vec4)?;
                own.iter().map(|own| own.map(f64::from)).collect()
            }
            _ => {
                let own = buffers.numbers::<3>(sampler.output, Type::Vec3)?;
                own.iter().map(|own| [own[0], own[1], own[2], 0.0].map(f64::from)).collect()
            }
        };
        let wanted =
            if let Interpolation::CubicSpline = how { 3 * times.len() } else { times.len() };
        if values.len() != wanted || times.is_empty() {
            let (times, values) = (times.len(), values.len());
            let sentence = format!("{values} values do not fit {times} times");
            return Err(wrong(field(), sentence));
        }
        let ascends = times.is_sorted_by(|a, b| a < b) && times.iter().all(|time| time.is_finite());
        if !ascends || !values.as_flattened().iter().all(|value| value.is_finite()) {
            let sentence = "times ascend, and numbers are finite";
            return Err(wrong(field(), sentence));
        }
        tracks.push(Track { place, part, how, times, values });
    }
    let warnings = &mut scene.parts.notes.warnings;
    for (count, what) in [
        (weights, "channels of morph weights are left out"),
        (fixed, "channels are left out: their nodes have a matrix"),
    ] {
        if count > 0 {
            warnings.push(format!("{count} {what}"));
        }
    }
    Ok(tracks)
}
