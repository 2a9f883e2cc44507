//! Which rows of a table an update has to write, and writing them.

use super::{Geometries, InstanceTable, Shown};
use crate::scene_data::{AppearanceError, NONE};
use splitplane_core::backend::scene::BuiltScene;
use splitplane_core::scene::{Changes, GeometryId, GeometryMesh, InstanceId};
use std::sync::{Arc, Weak};

/// What rows say of a geometry.
#[derive(Clone, Debug)]
struct Line {
    /// Names the arrays. It does not hold them: what a scene drops is free.
    mesh: Weak<GeometryMesh>,
    /// First triangle among all, number of triangles, and place among shapes or [`NONE`].
    numbers: [u32; 3],
}

/// By the name of a geometry what rows say of it; `None` where there is none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lines(Vec<Option<Line>>);

/// Instances that are not what a table was written for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Changed {
    /// At most these, by their names.
    These {
        /// Those whose rows change, in ascending order.
        rows: Vec<u32>,
        /// Those whose geometry has other arrays, which their rows do not tell.
        replaced: Vec<u32>,
    },
    /// Any may be.
    All,
}

impl Lines {
    fn of(
        scene: &BuiltScene,
        geometries: &Geometries<'_>,
        triangles: u32,
    ) -> Result<Lines, AppearanceError> {
        let mut lines = Vec::new();
        let mut shapes = 0;
        for (name, geometry) in scene.geometries() {
            let given = geometries.first_triangles.get(name.0 as usize).copied();
            let count = geometry.mesh().mesh().len() as u32;
            let numbers = if geometry.shapes().is_some() {
                shapes += 1;
                [given.unwrap_or(0), count, shapes - 1]
            } else {
                let lies_there =
                    |first: &u32| first.checked_add(count).is_some_and(|end| end <= triangles);
                let missing = AppearanceError::MissingGeometry { geometry: name.0 };
                [given.filter(lies_there).ok_or(missing)?, count, NONE]
            };
            lines.resize(name.0 as usize, None);
            lines.push(Some(Line { mesh: Arc::downgrade(geometry.mesh()), numbers }));
        }
        Ok(Lines(lines))
    }

    fn get(&self, geometry: GeometryId) -> Option<&Line> {
        self.0.get(geometry.0 as usize)?.as_ref()
    }

    /// The geometries of both, with what either says.
    fn pairs<'a>(
        &'a self,
        other: &'a Lines,
    ) -> impl Iterator<Item = (GeometryId, &'a Line, &'a Line)> {
        let pairs = self.0.iter().zip(&other.0).zip(0..);
        pairs.filter_map(|((a, b), name)| Some((GeometryId(name), a.as_ref()?, b.as_ref()?)))
    }

    pub(super) fn bytes(&self) -> usize {
        self.0.capacity() * size_of::<Option<Line>>()
    }
}

impl InstanceTable {
    /// Finds what [`InstanceTable::write`] has to write, where `edited` names the instances that were edited since the last call of
    /// that: their rows, and those of instances whose material is another. All are, where a geometry
    /// that stays is elsewhere among the triangles or the shapes.
    ///
    /// Materials are compared, 4 bytes an instance; instances are looked at one by one only where a geometry has other arrays.
    ///
    /// # Errors
    /// As for [`InstanceTable::new`].
    pub(crate) fn changed(
        &self,
        scene: &BuiltScene,
        geometries: &Geometries<'_>,
        triangles: u32,
        edited: Changes<'_>,
    ) -> Result<(Lines, Changed), AppearanceError> {
        let lines = Lines::of(scene, geometries, triangles)?;
        let Changes::These(edited) = edited else { return Ok((lines, Changed::All)) };
        if self.lines.pairs(&lines).any(|(_, was, is)| was.numbers != is.numbers) {
            return Ok((lines, Changed::All));
        }
        let mut rows: Vec<u32> = edited.iter().map(|name| name.0).collect();
        let others = self.lines.pairs(&lines).filter(|(_, was, is)| !was.mesh.ptr_eq(&is.mesh));
        let others: Vec<GeometryId> = others.map(|(name, ..)| name).collect();
        let mut replaced = Vec::new();
        if !others.is_empty() {
            let is_of = |geometry| others.binary_search(&geometry).is_ok();
            let all = scene.placements().filter(|(_, own)| is_of(own.instance.geometry));
            replaced.extend(all.map(|(name, _)| name.0));
        }
        let (was, is) = (&self.materials[..], geometries.materials);
        if was != is {
            let material =
                |list: &[u32], name: u32| list.get(name as usize).copied().unwrap_or(NONE);
            let longer = was.len().max(is.len()) as u32;
            rows.extend((0..longer).filter(|name| material(was, *name) != material(is, *name)));
        }
        rows.sort_unstable();
        rows.dedup();
        Ok((lines, Changed::These { rows, replaced }))
    }

    /// Writes the rows that [`InstanceTable::changed`] found for this scene and these geometries, and returns how many.
    pub(crate) fn write(
        &mut self,
        scene: &BuiltScene,
        geometries: &Geometries<'_>,
        lines: Lines,
        changed: &Changed,
    ) -> u32 {
        self.lines = lines;
        self.shapes.clear();
        let shapes = scene.geometries().filter(|(_, own)| own.shapes().is_some());
        self.shapes.extend(shapes.map(|(_, own)| Arc::clone(own.mesh())));
        if self.materials != geometries.materials {
            self.materials.clear();
            self.materials.extend_from_slice(geometries.materials);
        }
        let names = scene.all_placements().len();
        if self.rows.len() < names {
            self.rows.resize(names, None);
        }
        let mut written = 0;
        match changed {
            Changed::All => {
                self.rows.clear();
                self.rows.resize(names, None);
                for name in 0..names as u32 {
                    written += u32::from(self.write_row(scene, name));
                }
            }
            Changed::These { rows, .. } => {
                for name in rows {
                    written += u32::from(self.write_row(scene, *name));
                }
            }
        }
        written
    }

    /// Writes the row of an instance; `false` where there is none, and was none.
    fn write_row(&mut self, scene: &BuiltScene, name: u32) -> bool {
        let row = scene.placement(InstanceId(name)).and_then(|placement| {
            let [first, count, shapes] = self.lines.get(placement.instance.geometry)?.numbers;
            let material = self.materials.get(name as usize).copied().unwrap_or(NONE);
            Some(Shown::new(placement, (first, count), shapes, material))
        });
        let Some(place) = self.rows.get_mut(name as usize) else { return false };
        let writes = row.is_some() || place.is_some();
        *place = row;
        writes
    }
}
