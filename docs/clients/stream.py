"""Watches a robot: prints each frame of the live stream as a line of JSON, of arrays only the shapes.

`python stream.py [ADDRESS]`; needs numpy and websockets.
"""

import json
import struct
import sys

import numpy as np
from websockets.sync.client import connect

address = sys.argv[1] if len(sys.argv) > 1 else "ws://127.0.0.1:8000/api/v1/stream"
with connect(address) as socket:
    while frame := socket.recv(decode=False):
        sequence, size = struct.unpack_from("<II", frame)
        header, arrays, offset = json.loads(frame[8 : 8 + size]), {}, 8 + size
        for name, dtype, shape in header["arrays"]:
            arrays[name] = np.frombuffer(frame, dtype, int(np.prod(shape)), offset).reshape(shape)
            offset += -(-arrays[name].nbytes // 8) * 8  # each array starts at a multiple of eight bytes
        socket.send(json.dumps({"type": "ack", "seq": sequence}))  # without it the server waits for ever
        print(json.dumps({**header, "arrays": {name: array.shape for name, array in arrays.items()}}), flush=True)
