//! Where each unknown stands in the reduced normal equations.
//!
//! Three kinds: points that are eliminated first; poses that share no such point with one another
//! (the modules of a session, the photographs of a calibration) and are eliminated second, one by
//! one; and the border, which all may share and which is solved as a dense system. Indices of
//! unknowns run over the border first, then over the independent poses.

use super::problem::Problem;

/// Fewer independent poses than this are not worth a level of their own.
const FEWEST_INDEPENDENT: usize = 4;

/// A run of unknowns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Block {
    /// Index of the first.
    pub at: usize,
    /// How many.
    pub len: usize,
}

/// What becomes of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointPlace {
    /// Known exactly.
    Held,
    /// Eliminated.
    Eliminated,
    /// Three unknowns of the border, from this one.
    Border(usize),
}

/// Where each unknown stands.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    /// Per camera its pose, unless it is held.
    pub cameras: Vec<Option<Block>>,
    /// Per interior orientation its unknowns.
    pub interiors: Vec<Block>,
    /// Per module six unknowns of its pose, and its own scale as the seventh if that is unknown.
    pub modules: Vec<Block>,
    /// Per point.
    pub points: Vec<PointPlace>,
    /// The artefact's scale, if it is unknown.
    pub artefact_scale: Option<usize>,
    /// The shared fan's scale, if it is unknown.
    pub fan_scale: Option<usize>,
    /// First of two unknowns for each beam of the shared fan.
    pub fan_beams: usize,
    /// How many unknowns these are.
    pub fan_len: usize,
    /// Number of unknowns of the border.
    pub border: usize,
    /// The independent poses, in the order of their indices.
    pub independent: Vec<Block>,
    /// Number of unknowns, eliminated points apart.
    pub size: usize,
}

impl Layout {
    /// `all_points_in_border` keeps every point for a free network, whose datum they make.
    pub fn of(problem: &Problem, all_points_in_border: bool) -> Self {
        let points = places(problem, all_points_in_border);
        let (cameras, modules) = independent_poses(problem, &points);
        let mut layout = Self {
            cameras: vec![None; problem.cameras.len()],
            interiors: Vec::new(),
            modules: vec![Block { at: 0, len: 0 }; problem.modules.len()],
            points,
            artefact_scale: None,
            fan_scale: None,
            fan_beams: 0,
            fan_len: 0,
            border: 0,
            independent: Vec::new(),
            size: 0,
        };
        layout.place_border(problem, &cameras, &modules);
        layout.place_independent(problem, &cameras, &modules);
        layout
    }

    fn take(&mut self, len: usize) -> Block {
        self.size += len;
        Block { at: self.size - len, len }
    }

    fn place_border(&mut self, problem: &Problem, cameras: &[bool], modules: &[bool]) {
        // A camera's pose and interior orientation side by side: long runs are quick to sum.
        let mut interiors = vec![None; problem.interiors.len()];
        for (i, camera) in problem.cameras.iter().enumerate() {
            if !cameras[i] && !camera.is_held {
                self.cameras[i] = Some(self.take(6));
            }
            let interior = &mut interiors[camera.interior];
            if interior.is_none() {
                let unknowns = problem.interiors[camera.interior].unknowns.len();
                *interior = Some(self.take(unknowns));
            }
        }
        let nothing = Block { at: self.size, len: 0 };
        self.interiors = interiors.into_iter().map(|i| i.unwrap_or(nothing)).collect();
        for (i, module) in problem.modules.iter().enumerate() {
            if !modules[i] {
                self.modules[i] = self.take(module.unknowns());
            }
        }
        self.artefact_scale = (problem.artefact_scale_sigma > 0.0).then(|| self.take(1).at);
        self.fan_scale = (problem.fan.scale_sigma > 0.0).then(|| self.take(1).at);
        let beams = self.take(2 * problem.fan.beams.len());
        (self.fan_beams, self.fan_len) = (beams.at, beams.len);
        for i in 0..self.points.len() {
            if matches!(self.points[i], PointPlace::Border(_)) {
                self.points[i] = PointPlace::Border(self.take(3).at);
            }
        }
        self.border = self.size;
    }

    fn place_independent(&mut self, problem: &Problem, cameras: &[bool], modules: &[bool]) {
        for (i, module) in problem.modules.iter().enumerate().filter(|(i, _)| modules[*i]) {
            self.modules[i] = self.take(module.unknowns());
            self.independent.push(self.modules[i]);
        }
        for i in (0..problem.cameras.len()).filter(|i| cameras[*i]) {
            let block = self.take(6);
            self.cameras[i] = Some(block);
            self.independent.push(block);
        }
    }

    /// One past the last unknown of the shared fan's beams.
    pub fn fan_end(&self) -> usize {
        self.fan_beams + self.fan_len
    }

    /// Which independent pose an unknown belongs to, and its place in it.
    pub fn independent_at(&self, at: usize) -> Option<usize> {
        if at < self.border {
            return None;
        }
        Some(self.independent.partition_point(|block| block.at <= at) - 1)
    }
}

fn places(problem: &Problem, all_in_border: bool) -> Vec<PointPlace> {
    let mut places = vec![PointPlace::Eliminated; problem.points.len()];
    if all_in_border {
        places.fill(PointPlace::Border(0));
    }
    for bar in &problem.scale_bars {
        bar.ends.iter().for_each(|end| places[*end] = PointPlace::Border(0));
    }
    problem.held_points.iter().for_each(|point| places[*point] = PointPlace::Held);
    places
}

/// Which cameras and which modules share no eliminated point with another of the set: taken as
/// they come, modules first.
fn independent_poses(problem: &Problem, points: &[PointPlace]) -> (Vec<bool>, Vec<bool>) {
    let mut by_pose = vec![Vec::new(); problem.modules.len() + problem.cameras.len()];
    problem.beams.iter().for_each(|o| by_pose[o.module].push(o.point));
    let first_camera = problem.modules.len();
    let moving = problem.images.iter().filter(|o| !problem.cameras[o.camera].is_held);
    moving.for_each(|o| by_pose[first_camera + o.camera].push(o.point));
    let mut is_owned = vec![false; points.len()];
    let mut is_independent: Vec<bool> = by_pose
        .iter()
        .map(|seen| {
            let mut own = seen.iter().filter(|p| points[**p] == PointPlace::Eliminated);
            let is_free = own.clone().all(|p| !is_owned[*p]) && !seen.is_empty();
            if is_free {
                own.by_ref().for_each(|p| is_owned[*p] = true);
            }
            is_free
        })
        .collect();
    if is_independent.iter().filter(|is| **is).count() < FEWEST_INDEPENDENT {
        is_independent.fill(false);
    }
    let cameras = is_independent.split_off(first_camera);
    (cameras, is_independent)
}
