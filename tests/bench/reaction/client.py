"""A plain Spykee client that follows a red ball: Python and OpenCV in their usual form."""

import math
import socket
import struct
import sys

import cv2
import numpy as np

NEAR, SLACK, TURN, SPEED, HFOV = 90, 8, 2.2, 0.22, math.radians(60)
TRACK_WIDTH, FULL_SPEED = 0.24, 0.45


def packet(kind, payload=b""):
    return b"PK" + struct.pack(">BH", kind, len(payload)) + payload


def read_exactly(stream, count):
    data = bytearray()
    while len(data) < count:
        chunk = stream.recv(count - len(data))
        if not chunk:
            sys.exit(0)
        data += chunk
    return bytes(data)


def largest_red(jpeg):
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    mask = cv2.inRange(hsv, (0, 110, 60), (8, 255, 255)) | cv2.inRange(hsv, (172, 110, 60), (180, 255, 255))
    count, _, stats, centroids = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return None
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return centroids[best][0], stats[best, cv2.CC_STAT_WIDTH]


def drive(linear, angular):
    tracks = [linear - angular * TRACK_WIDTH / 2, linear + angular * TRACK_WIDTH / 2]
    scale = max(1.0, max(abs(track) for track in tracks) / FULL_SPEED)
    return [round(track / scale / FULL_SPEED * 90) for track in tracks]


def answer(jpeg):
    ball = largest_red(jpeg)
    if ball is None:
        return drive(0, 0.7)
    cx, width = ball
    bearing = -math.atan((cx - 159.5) / 160 * math.tan(HFOV / 2))
    missing = NEAR - width
    speed = 0 if abs(missing) <= SLACK else SPEED * min(max(2 * missing / NEAR, -0.4), 1)
    ahead = max(0, 1 - 2.5 * abs(bearing))
    return drive(speed * ahead, min(max(TURN * bearing, -1.2), 1.2))


def main():
    host, port = sys.argv[sys.argv.index("--robot") + 1].rsplit(":", 1)
    stream = socket.create_connection((host, int(port)))
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    stream.sendall(packet(10, b"\x05admin\x05admin"))
    stream.sendall(packet(15, b"\x01\x01"))
    while True:
        _, kind, length = struct.unpack(">2sBH", read_exactly(stream, 5))
        payload = read_exactly(stream, length)
        if kind == 2:
            stream.sendall(packet(5, struct.pack("bb", *answer(payload))))


main()
