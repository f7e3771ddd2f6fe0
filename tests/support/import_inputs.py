"""Small files to import, made from formulas: what the end-to-end tests of import need."""
import math
import struct
import zlib

WIDTH, HEIGHT = 64, 48


def colour(u, v):
    return (u * 3 % 256, v * 5 % 256, (u + v) % 256)


def depth_mm(u, v):
    """A slanted wall; a hole of unknown depth."""
    return 0 if 20 <= u < 24 and 10 <= v < 13 else 2000 + 10 * u + 5 * v


def disparity_px(u, v):
    """Whole pixels of a plane; 0 is unknown."""
    return 0 if u < 3 else round(20 + 0.21 * u + 0.13 * v)


def write_ppm(path, width=WIDTH, height=HEIGHT):
    pixels = b"".join(bytes(colour(u, v)) for v in range(height) for u in range(width))
    path.write_bytes(b"P6\n%d %d\n255\n" % (width, height) + pixels)


def write_pgm16(path, value, width=WIDTH, height=HEIGHT):
    pixels = b"".join(struct.pack(">H", value(u, v)) for v in range(height) for u in range(width))
    path.write_bytes(b"P5\n%d %d\n65535\n" % (width, height) + pixels)


def scan_text(rows=20, columns=30):
    """A .3d file of a scanner in a box of 4 x 3 x 6 m whose far wall has a window."""
    lines = []
    for row in range(rows):
        f = math.radians(-30 + 3 * row)
        for column in range(columns):
            t = math.radians(3 + 6 * column)
            d = (math.cos(t), math.sin(t) * math.sin(f), math.sin(t) * math.cos(f))
            r = min(h / abs(x) if abs(x) > 1e-9 else 1e9 for x, h in zip(d, (200, 150, 300)))
            p = [x * r for x in d]
            if p[2] > 299 and abs(p[0]) < 60 and 0 < p[1] < 100:
                r = 3276.7
            lines.append("%.7g %.7g %.7g\n" % tuple(x * r for x in d))
    return "".join(lines)


def ply_text(rows=24, columns=32):
    """A range grid of a dome, with holes outside it."""
    vertices, places = [], []
    for row in range(rows):
        for column in range(columns):
            x, y = (column - 16) * 0.01, (row - 12) * 0.01
            z2 = 0.012 - x * x - y * y
            if z2 < 0:
                places.append("0\n")
                continue
            places.append("1 %d\n" % len(vertices))
            vertices.append("%.7g %.7g %.7g\n" % (x, y, math.sqrt(z2)))
    return ("ply\nformat ascii 1.0\nobj_info num_cols %d\nobj_info num_rows %d\n"
            "element vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
            "element range_grid %d\nproperty list uchar int vertex_indices\nend_header\n"
            % (columns, rows, len(vertices), rows * columns) + "".join(vertices) + "".join(places))


SPIN_CALIB = ("P0: 60 0 31.5 0 0 60 23.5 0 0 0 1 0\nP2: 60 0 31.5 6 0 60 23.5 0 0 0 1 0\n"
              "R0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 -0.25\n")


def spin_points(rings=32, steps=720):
    """A spinning laser in a room of 8 x 6 x 4 m, ring by ring, as KITTI stores it."""
    points = []
    for ring in range(rings):
        el = math.radians(16 - ring)
        for k in range(steps):
            az = 2 * math.pi * (k + 0.5) / steps
            d = (math.cos(el) * math.cos(az), math.cos(el) * math.sin(az), math.sin(el))
            r = min(h / abs(x) if abs(x) > 1e-9 else 1e9 for x, h in zip(d, (4, 3, 2)))
            points.append(struct.pack("<4f", *(x * r for x in d), 0.25 + 0.5 * (k % 2)))
    return b"".join(points)


def write_png(path, width=WIDTH, height=HEIGHT):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + b"".join(bytes(colour(u, v)) for u in range(width)) for v in range(height))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
                     + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
