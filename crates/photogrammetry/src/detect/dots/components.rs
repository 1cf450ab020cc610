//! Connected runs become candidates: what touches, or nearly touches, is one.

/// Pixels and rows that may be missing inside a component: dark speckle grains.
const GAP: usize = 2;

/// Consecutive pixels of one row above the threshold (gaps of dark grains included).
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    first: usize,
    last: usize,
    background: f64,
    step: f64,
    sums: Sums,
}

/// Sums over pixels, coordinates relative to the picture's corner.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    /// Coordinates, plain.
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    /// Excess over the background, and coordinates weighted by it.
    excess: f64,
    excess_x: f64,
    excess_y: f64,
    peak: f64,
    background: f64,
    step: f64,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.x += other.x;
        self.y += other.y;
        self.xx += other.xx;
        self.xy += other.xy;
        self.yy += other.yy;
        self.excess += other.excess;
        self.excess_x += other.excess_x;
        self.excess_y += other.excess_y;
        self.peak = self.peak.max(other.peak);
        self.background += other.background;
        self.step += other.step;
    }
}

impl Run {
    /// A run of one pixel, with the background and the threshold above it that hold there.
    pub(super) fn new(x: usize, pixel: u8, background: f64, step: f64) -> Self {
        let mut run = Self { first: x, last: x, background, step, sums: Sums::default() };
        run.add(x, pixel);
        run
    }

    /// Whether a pixel further on belongs to this run.
    pub(super) fn takes(&self, x: usize) -> bool {
        x <= self.last + 1 + GAP
    }

    /// Adds a pixel.
    pub(super) fn add(&mut self, x: usize, pixel: u8) {
        let excess = f64::from(pixel) - self.background;
        self.last = x;
        let x = x as f64;
        let sums = &mut self.sums;
        sums.count += 1.0;
        sums.x += x;
        sums.xx += x * x;
        sums.excess += excess;
        sums.excess_x += excess * x;
        sums.peak = sums.peak.max(excess);
    }

    /// Completes the sums with the row.
    fn set_row(&mut self, y: usize) {
        let y = y as f64;
        let sums = &mut self.sums;
        sums.y = sums.count * y;
        sums.xy = sums.x * y;
        sums.yy = sums.count * y * y;
        sums.excess_y = sums.excess * y;
        sums.background = sums.count * self.background;
        sums.step = sums.count * self.step;
    }
}

/// A place that may be a dot, as its pixels above the threshold show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    /// Centroid of the excess over the background, pixels.
    pub(super) x: f64,
    /// Likewise.
    pub(super) y: f64,
    /// Largest excess over the background, grey levels.
    pub(super) peak: f64,
    /// Sum of the excess, grey levels.
    pub(super) flux: f64,
    /// Local background, grey levels.
    pub(super) background: f64,
    /// Threshold above the background, grey levels.
    pub(super) step: f64,
    /// Second central moments of the pixels' places: xx, xy, yy.
    pub(super) spread: [f64; 3],
    /// Number of pixels.
    pub(super) count: f64,
}

#[derive(Debug, Clone, Copy)]
struct Component {
    parent: usize,
    sums: Sums,
    x: [usize; 2],
    y: [usize; 2],
}

/// Gathers runs into components, row after row.
pub(super) struct Collector {
    /// Wider or higher ones are no dots.
    max_extent: f64,
    row: usize,
    components: Vec<Component>,
    /// Runs of this row and of the `GAP + 1` rows above: row, first, last, component.
    recent: Vec<(usize, usize, usize, usize)>,
    /// Where in `recent` this row begins, and from where rows above are still of interest.
    row_start: usize,
    cursor: usize,
}

impl Collector {
    /// An empty one.
    pub(super) fn new(max_extent: f64) -> Self {
        Self {
            max_extent,
            row: 0,
            components: Vec::new(),
            recent: Vec::new(),
            row_start: 0,
            cursor: 0,
        }
    }

    /// Must be called before the runs of a row, rows in ascending order.
    pub(super) fn begin_row(&mut self, y: usize) {
        self.row = y;
        self.recent.retain(|run| run.0 + GAP + 1 >= y);
        self.recent.sort_unstable_by_key(|run| (run.1, run.0));
        self.row_start = self.recent.len();
        self.cursor = 0;
    }

    /// Adds the next run of the row, from left to right.
    pub(super) fn add(&mut self, mut run: Run) {
        run.set_row(self.row);
        let mut mine = self.components.len();
        self.components.push(Component {
            parent: mine,
            sums: run.sums,
            x: [run.first, run.last],
            y: [self.row, self.row],
        });
        for i in self.cursor..self.row_start {
            let (_, first, last, component) = self.recent[i];
            if first > run.last + 1 + GAP {
                break;
            }
            if last + 1 + GAP >= run.first {
                mine = self.join(component, mine);
            }
        }
        self.recent.push((self.row, run.first, run.last, mine));
        // Runs above that end far to the left, and all before them, meet no later run.
        while self.cursor < self.row_start && self.recent[self.cursor].2 + 1 + GAP < run.first {
            self.cursor += 1;
        }
    }

    fn root(&mut self, mut index: usize) -> usize {
        while self.components[index].parent != index {
            let grandparent = self.components[self.components[index].parent].parent;
            self.components[index].parent = grandparent;
            index = grandparent;
        }
        index
    }

    /// Joins two components; the older one stays.
    fn join(&mut self, a: usize, b: usize) -> usize {
        let (a, b) = (self.root(a), self.root(b));
        let (keep, gone) = (a.min(b), a.max(b));
        if keep != gone {
            let other = self.components[gone];
            self.components[gone].parent = keep;
            let kept = &mut self.components[keep];
            kept.sums.add(&other.sums);
            kept.x = [kept.x[0].min(other.x[0]), kept.x[1].max(other.x[1])];
            kept.y = [kept.y[0].min(other.y[0]), kept.y[1].max(other.y[1])];
        }
        keep
    }

    /// The candidates, by descending flux.
    pub(super) fn finish(self) -> Vec<Candidate> {
        let max_extent = self.max_extent;
        let mut candidates: Vec<Candidate> = self
            .components
            .iter()
            .enumerate()
            .filter(|(index, component)| {
                let extent = (component.x[1] - component.x[0]).max(component.y[1] - component.y[0]);
                component.parent == *index
                    && component.sums.count >= 3.0
                    && extent as f64 <= max_extent
            })
            .map(|(_, component)| Candidate::from_sums(&component.sums))
            .collect();
        candidates.sort_by(|a, b| b.flux.total_cmp(&a.flux));
        candidates
    }
}

impl Candidate {
    fn from_sums(sums: &Sums) -> Self {
        let (x, y) = (sums.x / sums.count, sums.y / sums.count);
        Self {
            x: sums.excess_x / sums.excess,
            y: sums.excess_y / sums.excess,
            peak: sums.peak,
            flux: sums.excess,
            background: sums.background / sums.count,
            step: sums.step / sums.count,
            spread: [
                sums.xx / sums.count - x * x,
                sums.xy / sums.count - x * y,
                sums.yy / sums.count - y * y,
            ],
            count: sums.count,
        }
    }
}
