#!/usr/bin/env python3
"""Reads a tile pack with nothing but what docs/tile-format.md says.
Usage: tile_pack_reader.py PACK [--summary]   prints counts as JSON; exit status 1 if anything disagrees with the page."""
import ctypes
import ctypes.util
import json
import math
import struct
import sys

zstd = ctypes.CDLL(ctypes.util.find_library("zstd") or "libzstd.so.1")
zstd.ZSTD_decompress.restype = ctypes.c_size_t
zstd.ZSTD_decompress.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t]


class Bad(Exception):
    pass


def need(condition, what):
    if not condition:
        raise Bad(what)


table = []
for n in range(256):
    for _ in range(8):
        n = n >> 1 ^ (0x82F63B78 if n & 1 else 0)
    table.append(n)


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 255]
    return crc ^ 0xFFFFFFFF


def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]


def part(data, raw):
    if len(data) == raw:
        return data
    out = ctypes.create_string_buffer(max(raw, 1))
    need(zstd.ZSTD_decompress(out, raw, data, len(data)) == raw, "a part does not decompress to its size")
    return out.raw[:raw]


def predict(kind, a, b, c):
    if kind == 1:
        return (3 * a + 3 * b - 2 * c + 2) >> 2
    return min(a, b) if c >= max(a, b) else max(a, b) if c <= min(a, b) else a + b - c


def unzigzag(z):
    return z >> 1 ^ -(z & 1)


def plane_at(plane, u, v):
    return f32(f32(plane[0] + f32(plane[1] * u)) + f32(plane[2] * v))


def decode_colour(data, w, h, kind):
    planes = []
    for channel in range(3):
        plane = []
        for i in range(w * h):
            left, above = i % w > 0, i >= w
            if left and above:
                p = min(max(predict(kind, plane[i - 1], plane[i - w], plane[i - w - 1]), 0), 255)
            else:
                p = plane[i - 1] if left else plane[i - w] if above else 0
            plane.append((p + unzigzag(data[channel * w * h + i])) & 255)
        planes.append(plane)
    return [((r - 128 + g) & 255, g, (b - 128 + g) & 255) for g, r, b in zip(*planes)]


def decode_levels(data, have, w, kind, each, base, step, plane):
    n, at, level, out = sum(have), 0, [0] * len(have), [math.nan] * len(have)
    for i, coded in enumerate(have):
        if not coded:
            continue
        z = sum(data[b * n + at] << 8 * b for b in range(each))
        at += 1
        if step == 0:
            out[i] = struct.unpack("<f", struct.pack("<I", z))[0]
            continue
        a, b = i % w > 0 and have[i - 1], i >= w and have[i - w]
        if kind == 0:
            x = (plane_at(plane, i % w, i // w) - base) / step
            p = math.floor(x + 0.5) if -2**24 < x < 2**25 else 0
        elif a and b and have[i - w - 1]:
            p = predict(kind, level[i - 1], level[i - w], level[i - w - 1])
        else:
            p = level[i - 1] if a else level[i - w] if b else 0
        level[i] = p + unzigzag(z)
        need(0 <= level[i] < 2**24, "a level out of bounds")
        out[i] = f32(base + step * level[i])
    return out


def decode(data):
    """(w, h, kind, step, disparities, colours, flags, confidences)"""
    kind, w, h, conf_step, disparity_kind, colour_kind, each, zero = data[:8]
    base, step, *plane = struct.unpack_from("<5f", data, 8)
    sizes = struct.unpack_from("<3H", data, 28)
    need(kind in (1, 2) and 1 <= w <= 33 and 1 <= h <= 33 and zero == 0, "a tile's header")
    need(34 + sum(sizes) == len(data), "a tile's parts do not fill it")
    count, mask_bytes = w * h, (w * h + 7) // 8
    starts = [34, 34 + sizes[0], 34 + sizes[0] + sizes[1]]
    parts = [data[s : s + n] for s, n in zip(starts, sizes)]
    rest = part(parts[2], mask_bytes + 2 * count)
    have = [rest[i // 8] >> i % 8 & 1 for i in range(count)]
    flags = rest[mask_bytes : mask_bytes + count]
    confidence = [c * conf_step for c in rest[mask_bytes + count :]]
    if kind == 2:
        disparity = [plane_at(plane, i % w, i // w) for i in range(count)]
    else:
        residuals = part(parts[0], sum(have) * each)
        disparity = decode_levels(residuals, have, w, disparity_kind, each, base, step, plane)
        disparity = [0.0 if flags[i] & 128 else d for i, d in enumerate(disparity)]
    return w, h, kind, step, disparity, decode_colour(part(parts[1], 3 * count), w, h, colour_kind), flags, confidence


def levels_of(w, h):
    while True:
        yield w, h, (w + 31) // 32, (h + 31) // 32
        if w <= 32 and h <= 32:
            return
        w, h = (w + 1) // 2, (h + 1) // 2


def read(path):
    data = open(path, "rb").read()
    need(data[:8] == b"SCTILES\n", "the first eight bytes")
    version, crc, photo_count, node_count, size = struct.unpack_from("<IIQQQ", data, 8)
    error_m, error_range_m = struct.unpack_from("<2d", data, 40)
    need(version == 1 and size == len(data), "version or size")
    nodes_at = 64 + 320 * photo_count
    tiles_at = nodes_at + 32 * node_count
    need(tiles_at <= len(data) and crc32c(data[16:tiles_at]) == crc, "the index's CRC")
    out = {"error_m": error_m, "error_range_m": error_range_m, "photos": [], "nodes": node_count}
    next_node = 0
    order = []
    for p in range(photo_count):
        at = 64 + 320 * p
        name = data[at : at + 64].split(b"\0")[0].decode()
        width, height = struct.unpack_from("<2I", data, at + 80)
        fx, fy, cx, cy = struct.unpack_from("<4d", data, at + 88)
        rotation = struct.unpack_from("<9d", data, at + 120)
        (first,) = struct.unpack_from("<q", data, at + 312)
        need(first == next_node, "the first node of a photograph")
        need(abs(sum(x * x for x in rotation) - 3) < 1e-9, "a rotation")
        photo = dict(name=name, width=width, height=height, levels=0, tiles=0, planes=0, samples=0, coded=0, rgb_sum=0)
        for level, (w, h, nx, ny) in enumerate(levels_of(width, height)):
            photo["levels"] += 1
            for j in range(ny):
                for i in range(nx):
                    offset, bytes_, tile_crc = struct.unpack_from("<QII", data, nodes_at + 32 * next_node)
                    low, high, _ = struct.unpack_from("<3f", data, nodes_at + 32 * next_node + 16)
                    valid, kind, _ = struct.unpack_from("<HBB", data, nodes_at + 32 * next_node + 28)
                    next_node += 1
                    if not bytes_:
                        continue
                    order.append((offset, level))
                    tile = data[offset : offset + bytes_]
                    need(offset >= tiles_at and len(tile) == bytes_ and crc32c(tile) == tile_crc, "a tile's CRC")
                    tw, th, tkind, step, disparity, rgb, flags, confidence = decode(tile)
                    need(tkind == kind, "a tile's kind")
                    need(tw == min(33, w - 32 * i) and th == min(33, h - 32 * j), "a tile's size")
                    own = [k for k in range(tw * th) if k % tw < 32 and k // tw < 32 and not math.isnan(disparity[k])]
                    need(len(own) == valid, "the count of samples")
                    seen = [d for k, d in enumerate(disparity) if not math.isnan(d) and not flags[k] & 128]
                    if kind == 1 and seen:
                        need(low - step <= min(seen) and max(seen) <= high + step, "a tile's bounds")
                    if level:
                        continue
                    photo["tiles"] += 1
                    photo["planes"] += kind == 2
                    photo["samples"] += len(own)
                    photo["rgb_sum"] += sum(sum(rgb[k]) for k in own)
                    photo["coded"] += bytes_
        out["photos"].append(photo)
    need(next_node == node_count, "the number of nodes")
    need([l for _, l in sorted(order)] == sorted((l for _, l in order), reverse=True), "coarsest levels first")
    return out


if __name__ == "__main__":
    try:
        result = read(sys.argv[1])
    except (Bad, struct.error, IndexError) as e:
        sys.exit(f"tile_pack_reader: {e}")
    print(json.dumps(result, indent=1))
