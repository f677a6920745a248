//! The first Gaussians.

use super::random_points;
use glam::DVec3;
use ibgs_data::dataset::Point;
use ibgs_data::scene::{SH_C0, from_points};

#[test]
fn first_scales_equal_brute_force() {
    let mut points = random_points(400, 9);
    // Heaps of equal points, a grid plane, a line: what trees stumble over.
    for i in 0..100 {
        points.push(Point { position: DVec3::new(1.0, 2.0, -0.0), color: [i, 0, 0] });
        let (x, y) = (f64::from(i % 10), f64::from(i / 10));
        points.push(Point { position: DVec3::new(x, y, 5.0), color: [i; 3] });
        points.push(Point { position: DVec3::new(7.0, 7.0, f64::from(i)), color: [i; 3] });
    }
    points.push(Point { position: DVec3::new(1.0, 2.0, 0.0), color: [0; 3] });
    for n in [1, 2, 3, 4, points.len()] {
        let points = &points[points.len() - n..];
        let g = from_points(points, 2, 0.1).unwrap();
        g.validate().unwrap();
        assert_eq!(g.len(), n);
        for (i, point) in points.iter().enumerate() {
            let mut squared: Vec<f64> =
                (0..n).filter(|&j| j != i).map(|j| points[j].position.distance_squared(point.position)).collect();
            squared.sort_by(f64::total_cmp);
            squared.truncate(3);
            let mean = squared.iter().sum::<f64>() / squared.len().max(1) as f64;
            let expected = mean.max(1e-7).sqrt();
            for log_scale in g.log_scales[i] {
                let scale = f64::from(log_scale).exp();
                assert!((scale / expected - 1.0).abs() < 1e-5, "{n} {i}: {scale} {expected}");
            }
        }
    }
}

#[test]
fn first_gaussians_have_the_values_of_the_method() {
    let points = random_points(20, 10);
    for degree in 0..=3 {
        let g = from_points(&points, degree, 0.1).unwrap();
        let row = 3 * (degree as usize + 1).pow(2);
        for (i, point) in points.iter().enumerate() {
            let sh = &g.sh[i * row..(i + 1) * row];
            for (dc, byte) in sh.iter().zip(point.color) {
                let color = 0.5 + SH_C0 * f64::from(*dc);
                assert!((color - f64::from(byte) / 255.0).abs() < 1e-6);
            }
            assert!(sh[3..].iter().all(|&v| v == 0.0));
            assert!((1.0 / (1.0 + (-g.opacity_logits[i]).exp()) - 0.1).abs() < 1e-6);
        }
        assert!(g.rotations.iter().all(|&q| q == [1.0, 0.0, 0.0, 0.0]));
        assert!(g.normals.iter().all(|&n| n == [0.0, 0.0, 1.0]));
        assert!(g.offsets.iter().all(|&d| d == 0.0));
    }
    assert!(from_points(&[], 2, 0.1).unwrap().is_empty());
    let mut bad = points;
    bad[3].position.y = f64::NAN;
    assert!(from_points(&bad, 2, 0.1).unwrap_err().to_string().contains("point 3"));
    bad[3].position.y = 1e300;
    assert!(from_points(&bad, 2, 0.1).is_err());
    assert!(from_points(&[], 4, 0.1).is_err());
    assert!(from_points(&[], 2, 1.0).is_err());
    assert!(from_points(&[], 2, f64::NAN).is_err());
}
