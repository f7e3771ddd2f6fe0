#!/usr/bin/env python3
"""Verifies a site from docs/site-format.md alone: rows, digests, chains, custody, seal, files. The oracle of `scancart check`.

Usage: site_verify.py SITE_FOLDER      verifies one
       site_verify.py --test           a new site (made by $SCANCART_BIN) and the kept one of schema version 1
"""
import hashlib
import json
import os
import sqlite3
import struct
import subprocess
import sys
import tempfile

TABLES = ['site', 'georef', 'station', 'station_pose', 'calib', 'stream', 'chunk', 'ledger', 'file', 'frame', 'job',
          'job_hash', 'photo', 'custody']
FOLDERS = {1: 'frames', 2: 'photos', 3: 'tiles'}


def sha256(*parts):
    return hashlib.sha256(b''.join(parts)).digest()


def i64(*values):
    return struct.pack('<%dq' % len(values), *values)


def value_bytes(value):
    if value is None:
        return b'n'
    if isinstance(value, int):
        return b'i' + i64(value)
    if isinstance(value, float):
        return b'f' + struct.pack('<d', value + 0.0)
    data, kind = (value.encode(), b't') if isinstance(value, str) else (value, b'b')
    return kind + i64(len(data)) + data


def row_hash(table, values):
    return sha256(b'scancart/row/1\0', table.encode(), b'\0', *map(value_bytes, values))


def crc32c(data):
    crc = 0xffffffff
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82f63b78 if crc & 1 else 0)
    return crc ^ 0xffffffff


def check(condition, what):
    if not condition:
        sys.exit('site_verify: ' + what)


def verify_tables(db):
    digests = {name: (rows, total) for name, rows, total, _ in db.execute('SELECT * FROM digest')}
    check(sorted(digests) == sorted(TABLES), 'digest does not name all tables')
    for name, rows, total, stored in db.execute('SELECT * FROM digest'):
        check(row_hash('digest', (name, rows, total)) == stored, 'digest of ' + name)
    for table in TABLES:
        cursor = db.execute('SELECT * FROM ' + table)
        at = [column[0] for column in cursor.description].index('row_sha256')
        count = total = 0
        for row in cursor:
            check(row_hash(table, row[:at]) == row[at], '%s, row %s' % (table, row[0]))
            count += 1
            total += int.from_bytes(row[at], 'little')
        check(digests[table] == (count, (total % (1 << 256)).to_bytes(32, 'little')), 'digest of ' + table)
    return digests


def verify_streams(db):
    chunks = 0
    for stream, row in db.execute('SELECT id, row_sha256 FROM stream').fetchall():
        link, end, stored = sha256(b'scancart/stream/1\0', row), 0, 0
        for (sequence, first_ns, last_ns, first, end, items, size, codec, crc, chain, payload) in db.execute(
                'SELECT sequence, t_first_ns, t_last_ns, first_item, end_item, item_count, size_bytes, codec, crc32c, chain,'
                ' payload FROM chunk WHERE stream_id = ? ORDER BY sequence', (stream,)):
            check(crc32c(payload) == crc, 'CRC of chunk %d' % sequence)
            check(codec == 0, 'compressed: not read here')
            link = sha256(link, i64(sequence, first_ns, last_ns, first, end, items, size), payload)
            check(link == chain, 'chain at chunk %d' % sequence)
            stored += items
            chunks += 1
        lost = db.execute('SELECT coalesce(sum(max(0, min(end_item, ?2) - first_item)), 0) FROM ledger'
                          ' WHERE stream_id = ?1', (stream, end)).fetchone()[0]
        check(end == stored + lost, 'balance of stream %d' % stream)
    return chunks


def verify_custody(db, digests):
    link = sha256(b'scancart/custody/1\0', db.execute('SELECT uuid FROM site').fetchone()[0])
    what = detail = None
    for (sequence, utc_ns, who, program, what, detail, stored, _) in db.execute('SELECT * FROM custody ORDER BY id'):
        text = ''.join(part + '\0' for part in (who, program, what, detail)).encode()
        link = sha256(link, i64(sequence, utc_ns), text)
        check(link == stored, 'custody event %d' % sequence)
    check(what == 'sealed', 'not sealed')
    seal = sha256(*(name.encode() + b'\0' + i64(digests[name][0]) + digests[name][1]
                    for name in TABLES if name != 'custody'))
    check(json.loads(detail)['digest'] == seal.hex(), 'the seal')


def verify_files(db, folder):
    for kind, digest, extension, size in db.execute('SELECT kind, sha256, extension, size_bytes FROM file'):
        path = os.path.join(folder, FOLDERS[kind], digest.hex() + '.' + extension)
        with open(path, 'rb') as file:
            data = file.read()
        check(len(data) == size and sha256(data) == digest, path)


def verify(db, folder=None):
    digests = verify_tables(db)
    chunks = verify_streams(db)
    verify_custody(db, digests)
    if folder:
        verify_files(db, folder)
    print('site_verify: good: %d rows, %d chunks' % (sum(rows for rows, _ in digests.values()), chunks))


def main():
    if sys.argv[1:] != ['--test']:
        folder = sys.argv[1]
        return verify(sqlite3.connect('file:%s/site.db?mode=ro' % folder, uri=True), folder)
    kept = sqlite3.connect(':memory:')
    with open('tests/golden/site_v1.sql', encoding='utf-8') as file:
        kept.executescript(file.read())
    verify(kept)
    with tempfile.TemporaryDirectory() as folder:
        site = os.path.join(folder, 'site')
        subprocess.run([os.environ['SCANCART_BIN'], 'new', site, '--epsg', '25832', '--offset', '1,2,-0'], check=True)
        verify(sqlite3.connect('file:%s/site.db?mode=ro' % site, uri=True), site)
    return 0


if __name__ == '__main__':
    sys.exit(main())
