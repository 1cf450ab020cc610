//! Closing in: which spot is the dot, and where the axis goes next. Pure.
//!
//! The dot is the spot that stands where the nominal pattern expects it and moves as the axis does:
//! a reflection that stands still, or a neighbour, is not taken for it. How far the dot moves for a
//! unit of the axis is known roughly and measured on the way. An axis with lost motion shows by
//! moving less than it was told when it turns back; from then on the pixel is approached from one
//! side only.

/// From how far the reference pixel is approached, pixels: enough to tell what moves.
const APPROACH_PX: f64 = 20.0;
/// How much of the way a spot must have moved with the axis to be believed, pixels.
const BELIEVED_PX: f64 = 5.0;
/// A long way is gone this much too short, pixels: what is left is then gone in the same direction.
const SHORT_PX: f64 = 0.7;
/// Looks nearer to the pixel than this tell together where the dot is, pixels.
const NEAR_PX: f64 = 2.0;
/// What stands nearer to where a spot stood before has not moved, pixels.
const STILL_PX: f64 = 0.5;
/// How far from its prediction a spot may stand: a part of the way that it moved, but no less than
/// this, pixels.
const GATE_PX: f64 = 2.0;
/// See [`GATE_PX`]: the rough scale may be off by so much.
const GATE_PART: f64 = 0.25;

/// What is to be reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Goal {
    /// Where the dot is to stand, pixels.
    pub target_px: [f64; 2],
    /// How far off it may stand along its way, pixels.
    pub tolerance_px: f64,
    /// Roughly how far a dot moves for each unit of the axis, pixels.
    pub px_per_unit: [f64; 2],
    /// Roughly where the axis then stands.
    pub expected: f64,
    /// How roughly, in the axis' unit.
    pub within: f64,
    /// How many moves it may take.
    pub moves: u32,
}

/// What comes next.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Next {
    /// The axis goes there; then the next look.
    MoveTo(f64),
    /// The dot stands where it should, so many pixels off along its way.
    There { dot_px: [f64; 2], off_px: f64 },
    /// It cannot be had, for this reason.
    GiveUp(String),
}

/// A spot followed from look to look: where the axis stood and where the spot was.
#[derive(Debug, Clone)]
struct Track {
    places: Vec<(f64, [f64; 2])>,
    /// How far it has moved as the axis did, pixels.
    moved_px: f64,
}

/// A closing-in under way.
#[derive(Debug, Clone)]
pub(crate) struct ClosingIn {
    goal: Goal,
    gain: [f64; 2],
    tracks: Vec<Track>,
    /// What stood still while the axis moved.
    strays: Vec<[f64; 2]>,
    /// All spots of the look before.
    before: Vec<[f64; 2]>,
    /// What the axis was told and what it read, look by look.
    axis: Vec<(f64, f64)>,
    has_lost_motion: bool,
    /// The dot of the last look.
    dot_px: Option<[f64; 2]>,
}

impl ClosingIn {
    /// Begins; the first move goes to [`Self::start`].
    pub(crate) fn new(goal: Goal) -> Self {
        let gain = goal.px_per_unit;
        Self {
            goal,
            gain,
            tracks: Vec::new(),
            strays: Vec::new(),
            before: Vec::new(),
            axis: Vec::new(),
            has_lost_motion: false,
            dot_px: None,
        }
    }

    /// Where the axis goes first: short of where the dot is expected at its pixel.
    pub(crate) fn start(&self) -> f64 {
        self.goal.expected - self.approach()
    }

    /// The dot of the last look; `None` where it was not found.
    pub(crate) fn dot_px(&self) -> Option<[f64; 2]> {
        self.dot_px
    }

    /// How many moves there were.
    pub(crate) fn moves(&self) -> usize {
        self.axis.len()
    }

    /// What comes after a look: the axis was told to go to `commanded`, reads `read`, and the
    /// picture has these spots.
    pub(crate) fn look(&mut self, commanded: f64, read: f64, spots: &[[f64; 2]]) -> Next {
        self.watch_axis(commanded, read);
        let from = self.axis.last().map_or(read, |last| last.1);
        self.axis.push((commanded, read));
        let moving = self.without_strays((read - from) * norm(self.gain), spots);
        self.follow(read, &moving);
        let Some(track) = self.best(read) else {
            self.dot_px = None;
            return Next::GiveUp(self.why_no_dot(read, spots));
        };
        let (dot_px, is_believed) = (track.last(), track.moved_px >= BELIEVED_PX);
        if is_believed {
            self.gain = track.gain().unwrap_or(self.gain);
        }
        self.dot_px = Some(dot_px);
        let off_px = self.off_px(read);
        if is_believed && off_px.abs() <= self.goal.tolerance_px {
            return Next::There { dot_px, off_px };
        }
        if self.moves() >= self.goal.moves as usize {
            return Next::GiveUp(self.why_not_there(off_px));
        }
        Next::MoveTo(self.next(commanded, read, off_px, is_believed))
    }

    /// Where to go from here. What the axis read short of what it was told is told beside.
    fn next(&self, commanded: f64, read: f64, off_px: f64, is_believed: bool) -> f64 {
        let (scale, mismatch) = (norm(self.gain), commanded - read);
        let needed = -off_px / scale;
        let goal = read + needed;
        let approach = self.approach();
        if !is_believed && needed.abs() * scale < BELIEVED_PX {
            // It stands at the pixel already, and nobody knows yet whether it is the dot.
            return goal - approach + mismatch;
        }
        if needed < 0.0 && (self.has_lost_motion || needed < -approach) {
            return goal - approach + mismatch;
        }
        let long = needed * scale > 5.0 * SHORT_PX;
        let short = if long { SHORT_PX / scale } else { 0.0 };
        goal - short + mismatch
    }

    fn approach(&self) -> f64 {
        APPROACH_PX / norm(self.gain)
    }

    /// Turned back, the axis moved less than half of what it was told: it has lost motion.
    fn watch_axis(&mut self, commanded: f64, read: f64) {
        let [.., before, last] = self.axis[..] else { return };
        let (told, moved) = (commanded - last.0, read - last.1);
        let told_before = last.0 - before.0;
        if told * told_before < 0.0 && moved / told < 0.5 {
            self.has_lost_motion = true;
        }
    }

    /// The spots but for those that stood still when the axis last moved, and so many pixels' worth.
    fn without_strays(&mut self, way_px: f64, spots: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mut moving = spots.to_vec();
        let take_out = |stray: [f64; 2], moving: &mut Vec<[f64; 2]>| {
            let at = (0..moving.len())
                .filter(|i| apart(moving[*i], stray) <= STILL_PX)
                .min_by(|a, b| apart(moving[*a], stray).total_cmp(&apart(moving[*b], stray)));
            at.map(|at| moving.swap_remove(at)).is_some()
        };
        for stray in &self.strays {
            take_out(*stray, &mut moving);
        }
        if way_px.abs() >= BELIEVED_PX {
            for spot in std::mem::take(&mut self.before) {
                if take_out(spot, &mut moving) {
                    self.strays.push(spot);
                }
            }
        }
        self.before.clone_from(&moving);
        moving
    }

    /// Follows every spot that may be the dot to this look; what does not move as the axis does is
    /// dropped.
    fn follow(&mut self, read: f64, spots: &[[f64; 2]]) {
        let gain = self.gain;
        let followed = self.tracks.drain(..).filter_map(|mut track| {
            let (from, last) = (track.places.last()?.0, track.last());
            let way = gain.map(|g| g * (read - from));
            let predicted = [last[0] + way[0], last[1] + way[1]];
            let gate = f64::max(GATE_PX, GATE_PART * norm(way));
            let spot = nearest(spots, predicted).filter(|it| apart(*it, predicted) <= gate)?;
            track.moved_px += norm(way);
            track.places.push((read, spot));
            Some(track)
        });
        self.tracks = followed.collect();
        if self.tracks.is_empty() {
            let (expected, within) = (self.expected_px(read), self.goal.within * norm(gain));
            let near = spots.iter().filter(|spot| apart(**spot, expected) <= within);
            let track = |spot: &[f64; 2]| Track { places: vec![(read, *spot)], moved_px: 0.0 };
            self.tracks = near.map(track).collect();
        }
    }

    /// The track that is the dot: one that moved as the axis did, nearest to where the pattern
    /// expects it.
    fn best(&self, read: f64) -> Option<&Track> {
        let expected = self.expected_px(read);
        let rank = |track: &&Track| (track.moved_px < BELIEVED_PX, apart(track.last(), expected));
        self.tracks.iter().min_by(|a, b| {
            let (a, b) = (rank(a), rank(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        })
    }

    /// Where the nominal pattern has the dot when the axis reads so.
    fn expected_px(&self, read: f64) -> [f64; 2] {
        let from = read - self.goal.expected;
        [0, 1].map(|i| self.goal.target_px[i] + self.goal.px_per_unit[i] * from)
    }

    /// How far from its pixel a dot stands along the way that the axis moves it, pixels.
    fn along(&self, dot: [f64; 2]) -> f64 {
        let off = [0, 1].map(|i| dot[i] - self.goal.target_px[i]);
        (off[0] * self.gain[0] + off[1] * self.gain[1]) / norm(self.gain)
    }

    /// How far off the dot stands when the axis reads so, along its way, pixels: the mean of what
    /// the looks near the pixel say, so that the noise of one picture does not make the axis move.
    fn off_px(&self, read: f64) -> f64 {
        let places = self.best(read).map(|track| track.places.as_slice()).unwrap_or_default();
        let off =
            |place: &(f64, [f64; 2])| self.along(place.1) + norm(self.gain) * (read - place.0);
        let Some(last) = places.last() else { return f64::NAN };
        let near: Vec<f64> =
            places.iter().filter(|place| self.along(place.1).abs() < NEAR_PX).map(off).collect();
        if near.is_empty() { off(last) } else { near.iter().sum::<f64>() / near.len() as f64 }
    }

    fn why_no_dot(&self, read: f64, spots: &[[f64; 2]]) -> String {
        let [x, y] = self.expected_px(read);
        if self.moves() > 1 && !spots.is_empty() {
            return format!(
                "none of the {} spots in the picture moves as the axis does; {:.1} px for each \
                 unit is expected",
                spots.len(),
                norm(self.goal.px_per_unit)
            );
        }
        let within = self.goal.within * norm(self.goal.px_per_unit);
        let there = match spots.len() {
            0 => "no spot at all".to_owned(),
            1 => "one spot, elsewhere".to_owned(),
            n => format!("{n} spots, all elsewhere"),
        };
        format!("no dot within {within:.0} px of {x:.0}, {y:.0}: the picture has {there}")
    }

    fn why_not_there(&self, off_px: f64) -> String {
        let mut why = format!(
            "after {} moves the dot stands {off_px:+.3} px from its pixel; {} px is allowed",
            self.moves(),
            self.goal.tolerance_px
        );
        let (commanded, read) = self.axis.last().copied().unwrap_or_default();
        let is_away = (commanded - read).abs() * norm(self.gain) > 10.0 * self.goal.tolerance_px;
        if is_away {
            why += &format!("; the axis reads {read:.5} where it was told {commanded:.5}");
        }
        why
    }
}

impl Track {
    fn last(&self) -> [f64; 2] {
        self.places.last().map_or([f64::NAN; 2], |place| place.1)
    }

    /// The slope of its places over the axis; `None` where they lie too close together.
    fn gain(&self) -> Option<[f64; 2]> {
        let count = self.places.len() as f64;
        let at = self.places.iter().map(|place| place.0).sum::<f64>() / count;
        let square = self.places.iter().map(|place| (place.0 - at).powi(2)).sum::<f64>() / count;
        let slope = |i: usize| {
            let products = self.places.iter().map(|place| (place.0 - at) * place.1[i]);
            products.sum::<f64>() / count / square
        };
        let gain = [slope(0), slope(1)];
        let is_wide = square.sqrt() * norm(gain) > BELIEVED_PX / 2.0;
        (is_wide && gain.iter().all(|g| g.is_finite())).then_some(gain)
    }
}

fn norm(vector: [f64; 2]) -> f64 {
    f64::hypot(vector[0], vector[1])
}

fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    f64::hypot(a[0] - b[0], a[1] - b[1])
}

fn nearest(spots: &[[f64; 2]], to: [f64; 2]) -> Option<[f64; 2]> {
    spots.iter().copied().min_by(|a, b| apart(*a, to).total_cmp(&apart(*b, to)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stage and a picture: neighbours 3 units apart, a reflection that stands still.
    struct Bench {
        px_per_unit: f64,
        zero: f64,
        lost_motion: f64,
        overshoots: Vec<f64>,
        reflection: Option<[f64; 2]>,
        noise_px: f64,
        stands: f64,
        draws: u64,
    }

    impl Bench {
        fn new() -> Self {
            Self {
                px_per_unit: -43.0,
                zero: 0.31,
                lost_motion: 0.0,
                overshoots: Vec::new(),
                reflection: None,
                noise_px: 0.02,
                stands: -5.0,
                draws: 1,
            }
        }

        /// Evenly spread over -1 to 1.
        fn draw(&mut self) -> f64 {
            self.draws = self.draws.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (self.draws >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }

        fn go(&mut self, to: f64) {
            let to = to + self.overshoots.pop().unwrap_or_default();
            // The table follows when the play is taken up.
            let (low, high) = (to - self.lost_motion / 2.0, to + self.lost_motion / 2.0);
            self.stands = self.stands.clamp(low, high);
        }

        fn spots(&mut self) -> Vec<[f64; 2]> {
            let mut spots = Vec::new();
            for neighbour in -2..=2 {
                let off = self.stands - self.zero - 3.0 * f64::from(neighbour);
                let noise = [self.draw() * self.noise_px, self.draw() * self.noise_px];
                spots.push([320.0 + off * self.px_per_unit + noise[0], 241.0 + noise[1]]);
            }
            spots.extend(self.reflection);
            spots
        }

        /// Where the axis stands at the end and how many moves it took, or why it was given up.
        fn close_in(&mut self, expected: f64) -> Result<(f64, usize), String> {
            let goal = Goal {
                target_px: [320.0, 240.0],
                tolerance_px: 0.05,
                px_per_unit: [-40.0, 0.0],
                expected,
                within: 1.0,
                moves: 12,
            };
            let mut closing_in = ClosingIn::new(goal);
            let mut to = closing_in.start();
            loop {
                self.go(to);
                let (read, spots) = (self.stands, self.spots());
                match closing_in.look(to, read, &spots) {
                    Next::MoveTo(next) => to = next,
                    Next::There { .. } => return Ok((self.stands, closing_in.moves())),
                    Next::GiveUp(why) => return Err(why),
                }
            }
        }
    }

    #[track_caller]
    fn check(bench: &mut Bench, at: f64, moves: usize) {
        for turn in 0..50 {
            bench.draws += turn;
            let (stands, took) = bench.close_in(at).unwrap();
            assert!((stands - at - bench.zero).abs() < 0.0025, "{stands}");
            assert!(took <= moves, "{took} moves");
        }
    }

    #[test]
    fn a_dot_is_brought_to_its_pixel_in_few_moves() {
        check(&mut Bench::new(), 0.0, 6);
        check(&mut Bench::new(), 3.0, 6);
        check(&mut Bench { px_per_unit: -48.0, ..Bench::new() }, -3.0, 6);
    }

    #[test]
    fn lost_motion_takes_more() {
        check(&mut Bench { lost_motion: 0.01, ..Bench::new() }, 0.0, 12);
        check(&mut Bench { lost_motion: 0.05, ..Bench::new() }, 3.0, 12);
    }

    #[test]
    fn a_stage_that_overshoots_is_brought_back() {
        for overshoot in [0.004, 0.1, 1.0] {
            check(&mut Bench { overshoots: vec![0.0, overshoot], ..Bench::new() }, 0.0, 8);
        }
    }

    #[test]
    fn a_reflection_is_not_taken_for_the_dot_wherever_it_stands() {
        for x in [290.0, 312.0, 320.0, 320.03, 327.0, 340.0] {
            check(&mut Bench { reflection: Some([x, 240.0]), ..Bench::new() }, 0.0, 9);
        }
    }

    #[test]
    fn what_cannot_be_had_says_why() {
        // The module stands elsewhere: its neighbours are as far off.
        let mut far = Bench { zero: 1.5, ..Bench::new() };
        let why = far.close_in(0.0).unwrap_err();
        assert_eq!(why, "no dot within 40 px of 340, 240: the picture has 5 spots, all elsewhere");
        let mut fixed = Bench { px_per_unit: 0.0, zero: 0.0, ..Bench::new() };
        let why = fixed.close_in(0.0).unwrap_err();
        assert!(why.contains("moves as the axis does"), "{why}");
        let mut noisy = Bench { noise_px: 1.5, ..Bench::new() };
        let why = (0..50).find_map(|_| noisy.close_in(0.0).err()).unwrap();
        assert!(why.starts_with("after 12 moves the dot stands "), "{why}");
    }
}
