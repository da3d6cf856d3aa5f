//! Thinning of polylines.

/// What a line may be off by, pixels.
const TOLERANCE: f64 = 0.1;

/// Which points (pixels) a polyline cannot do without: everything left out lies within
/// [`TOLERANCE`] of the line that remains (Ramer 1972; Douglas & Peucker 1973).
pub(super) fn needed(points: &[[f64; 2]]) -> Vec<bool> {
    if points.len() < 3 {
        return vec![true; points.len()];
    }
    let mut keep = vec![false; points.len()];
    let last = points.len() - 1;
    (keep[0], keep[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((from, to)) = open.pop() {
        let mut farthest = (TOLERANCE, None);
        for i in from + 1..to {
            let d = distance(points[i], points[from], points[to]);
            if d > farthest.0 {
                farthest = (d, Some(i));
            }
        }
        if let Some(i) = farthest.1 {
            keep[i] = true;
            open.push((from, i));
            open.push((i, to));
        }
    }
    keep
}

/// Distance of `p` from the segment a–b.
fn distance(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let squared = dx * dx + dy * dy;
    let along = match squared > 0.0 {
        true => (((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / squared).clamp(0.0, 1.0),
        false => 0.0,
    };
    libm::hypot(p[0] - a[0] - along * dx, p[1] - a[1] - along * dy)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thinned(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let kept = points.iter().zip(needed(points)).filter(|(_, keep)| *keep);
        kept.map(|(p, _)| *p).collect()
    }

    #[test]
    fn corners_stay_and_straights_go() {
        let mut line: Vec<[f64; 2]> = (0..100).map(|i| [f64::from(i), 0.0]).collect();
        line.extend((0..50).map(|i| [99.0, f64::from(i)]));
        assert_eq!(thinned(&line), [[0.0, 0.0], [99.0, 0.0], [99.0, 49.0]]);
    }

    #[test]
    fn nothing_moves_by_more_than_the_tolerance() {
        let line: Vec<[f64; 2]> = (0..400)
            .map(|i| [f64::from(i), 80.0 * (f64::from(i) * 0.05).sin()])
            .collect();
        let kept = thinned(&line);
        assert!(kept.len() < 200);
        for p in &line {
            let off = kept
                .windows(2)
                .map(|s| distance(*p, s[0], s[1]))
                .fold(f64::INFINITY, f64::min);
            assert!(off <= TOLERANCE);
        }
    }
}
