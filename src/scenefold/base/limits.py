"""Every bound of the system with its reason. Relations between bounds are asserted at the end."""

from __future__ import annotations

PAYLOAD_BYTES_MAX = 60 * 1024
"""Payload of one record: what fits a UDP datagram with its header (storage.md)."""
FRAME_BYTES_MAX = 8 * 1024 * 1024
"""One frame on a TCP connection, checked before allocation."""
DATAGRAM_BYTES_MAX = 1400
"""A status datagram stays below common path MTUs."""
PASS_PATHS_MAX = 65_536
"""Paths of one pass: their index is 16 bits in the ray record."""
PASSES_MAX = 1 << 20
"""Of one job: a set of them, as bits, fits a document."""
RAY_FRAME_ITEMS_MAX = 1_024
"""Batches of rays that one node of a job sends another at a time, passes whose counts it tells, and passes that it says are closed."""
ATOM_TRIANGLES_MAX = 1_000
"""Triangles of a geometry atom, so that it fits one record."""
GROUP_TRIANGLES_TARGET = 8_000
"""Triangles of a group, the unit of paging and of what a cell holds."""
SPACE_DIMENSIONS_MAX = 8
"""Three bits on the wire hold dimensions minus one."""
SPACE_PLACE_BITS = 24
"""2 to this: places along an axis of a space that numbers must tell apart, wherever the space is moved to; as many as float32 has."""
NODES_MAX = 1_024
"""Registered nodes of one cluster, and statuses in a routing table: what the simulation covers."""
POOL_NODES_MAX = 127
"""Nodes that render together, and nodes of a local cluster: what the partition kernels and the tests cover."""
PORT_LOW_PRIORITY = 17349
"""Data, rays, images; UDP and TCP."""
PORT_HIGH_PRIORITY = 17350
"""Status, scene log, pools; UDP and TCP."""

RECORD_OVERHEAD_BYTES_MAX = 1024
"""Header (181 bytes) and signature (at most 384) of one record, with room for their next version."""
CIPHERTEXT_BYTES_MAX = PAYLOAD_BYTES_MAX + 16
"""A payload and its authentication tag."""
BULK_ITEMS_MAX = 8_192
"""Items of one bulk put or get: a frame of small records, at 1 KiB each."""
RANGE_LOCATIONS_MAX = 65_536
"""Locations of one range answer: 1.4 MiB, decoded in some 20 ms; with object ids 2.5 MiB."""
HANDOVER_BATCH_RECORDS_MAX = 4_096
"""Records of one packet of a handover: their keys and digests make 300 KiB; their bytes a frame, whichever is first."""
LOG_BYTES_MAX = 4 * 1024 * 1024
"""A scene log in one packet, so that it fits a frame beside its header."""
LOG_RECORD_BYTES_MAX = 256 * 1024
"""One log record: the founding of the largest cluster takes 110 KiB."""
LOG_RECORDS_MAX = 65_536
"""Records of a log that travel together: LOG_BYTES_MAX holds fewer, each with its signature of 64 bytes."""
LOG_REQUESTS_KEPT = 65_536
"""Positions of a scene's log whose request ids count: nine hours of changes at the rate that nodes allow, in 1 MiB of a snapshot."""
LOG_TAIL_RECORDS_MAX = 1_024
"""Records of a scene's log behind its snapshot; with one more its author makes a newer one. They are folded in a tenth of a second or two."""
LOG_TAIL_BYTES_MAX = 512 * 1024
"""Likewise their bytes: a seventh of what a value holds."""
LOG_TAIL_RECORDS_KEPT = 256
"""The newest records, which stay behind a new snapshot: who reads now and then can compare it with what was read."""
LOG_TAIL_BYTES_KEPT = 128 * 1024
"""As many of these as have so many bytes, and one at least."""
SPACE_NAME_BYTES_MAX = 64
"""A space's name in its scene's log."""
SPACES_PER_SCENE_MAX = 256
"""Spaces that a public scene header lists, shadows included."""
WRITERS_PER_SCENE_MAX = 128
"""Writer keys that a public scene header lists, retired ones included. With the two bounds beside it, a hostile
list of scenes decodes in a second at most."""
SCENES_PAGE_BYTES_MAX = 2 * 1024 * 1024
"""Scene headers in one answer, but for one that is larger alone: with many members each, all of them do not fit a frame."""
LOCKBOX_BYTES_MAX = 1024
"""A scene's keys, sealed to one member: 272 bytes under X25519, 384 under RSA-3072."""
HEADER_KEYS_MAX = 64
"""How often a scene's header key may change: once for each owner that is revoked."""
FORMER_KEYS_MAX = 128
"""Keys of former epochs in a scene's header; those before them stand in its log alone."""
FORMER_KEYS_BYTES_MAX = 12 + 24 * FORMER_KEYS_MAX + 16
"""Sealed, with nonce and tag."""
CERTIFICATES_MAX = 128
"""In the decision of a scene's header: one today, those of all participants once several decide."""
CERTIFICATE_BYTES_MAX = 8 * 1024
"""One of them: a signature today; later also a list of those who decide from some position on."""
MEMBER_NAME_BYTES_MAX = 64
"""A member's name, as in "user:ada": at most 55 bytes of a certificate's common name."""
PARTICIPANTS_MAX = 127
"""Members named in one packet of the scene-log protocol: those who vote, never all nodes."""
DECIDERS_MAX = 33
"""Participants of one position of a log: a proposal visits them one after the other, and its votes are each of 64 bytes and a check."""
VOTERS_MAX = 7
"""Nodes that decide the cluster's own log and grant owner leases: of these, three may be away."""
LOG_BODY_BYTES_MAX = 3_801_088
"""What a value names by hashes: of a scene its header and its sealed log. Two values fit a frame: what somebody asks for, and what was begun before."""
LOG_VALUE_BYTES_MAX = LOG_RECORD_BYTES_MAX + LOG_BODY_BYTES_MAX + 16
"""What is decided at one position of a log, as it is kept and sent."""
DECIDED_MAX = 256
"""Positions that are told in one packet: as many as 4 MiB hold, and one at least."""
LOG_EXPOSED_MAX = 256
"""Values that a node may have put into votes of its own at one position while nothing is decided there: beyond it asks for nothing new."""
SCENES_LISTED_MAX = 512
"""Scenes of a cluster that go on, and scene headers in one answer; a cluster of a small studio holds some dozens."""
SCENES_PER_USER_MAX = 128
"""Scenes that one user may have made and not ended, so that nobody alone fills the list: it takes four."""
SCENES_KEPT_MAX = 2_048
"""Scenes of a cluster with those that were ended, whose headers stay."""
ENDED_PER_USER_MAX = 384
"""Scenes that one user may have made and ended: again it takes four to fill the list."""
BLACKLIST_MAX = 32
"""Addresses and prefixes of a blacklist: they must fit a status datagram beside everything else."""
SHADOWS_MAX = 7
"""Shadows of one space, so that it has eight copies at most."""
COPIES_MAX = 1 + SHADOWS_MAX
COPIES_DEFAULT = 3
"""Copies of a new space, those of a new scene among them: two disks may be lost, and one of them while the other is being replaced."""
COPIES_MIN_DEFAULT = 2
"""How many of the copies must be there before a write counts as done; all, if a space has fewer."""
CUSTODY_ENTRIES_MAX = 1_024
"""Custody entries of one packet: 280 bytes each. Who has more to say cuts its arc."""
CONFIGURATIONS_MAX = 4_096
"""Configurations of one piece of the line, which are told at once: 2 MiB. A piece with more is given in parts."""
SEGMENT_CONFIGURATIONS_MAX = 16
"""Of one segment, by which somebody may still be answered: one, but while holders change and some of them are away."""
SEGMENT_CONFIRMED_MAX = 256
"""Nodes that an owner waits for, or has waited for, at one segment: it has COPIES_MAX holders, and those before them."""
COMPARED_ARCS_MAX = 64
"""Arcs that two nodes compare in one packet: the sixteenths of four arcs."""
COMPARED_RECORDS_MAX = 256
"""Records of an arc that are listed instead of summed: the lists of a packet make 1.8 MiB, read in a fifth of a second."""
COPIES_TOLD_MAX = 64
"""Places of one packet that a reader tells an owner of: arcs of one comparison."""
HELD_CURSOR_BYTES_MAX = 64
"""Where a list of what a node holds goes on: the key of a record, 42 bytes, with room."""
CUSTODY_KEPT_MAX = 4_096
"""Custody entries that a node keeps: a holder has a few of each owner whose copies it holds. Written anew with each change, 300 KiB."""
CUSTODY_FLOORS_MAX = 1_024
"""Stretches of the line that a node keeps the highest number of; beyond it neighbours become one, which costs an owner a round trip."""
TEXT_BYTES_MAX = 1_024
"""A message for people, in UTF-8: a line or two."""
DOCUMENT_BYTES_MAX = 256 * 1024
"""A job or its state as a document: settings, never pixels."""
BULK_BYTES_MAX = FRAME_BYTES_MAX - 64 * 1024
"""One large `bin` field, so that its packet still fits a frame."""
VALUE_DEPTH_MAX = 16
"""Nesting of a packed document; the decoder recurses."""
VALUE_ITEMS_MAX = 200_000
"""Numbers, texts, keys and containers of a packed document together: some 20 MiB of Python objects."""

assert PAYLOAD_BYTES_MAX < FRAME_BYTES_MAX

# What a scene may hold (specs/05-scene-content.md).
COORDINATE_ABS_MAX = 1e9
"""Largest |coordinate|: a triangle's f32 cross product squared must stay finite."""
TRIANGLE_DOUBLE_AREA_MIN = 1e-18
"""Smallest length of a triangle's edge cross product: squared, it must stay a normal f32."""
MATERIALS_MAX = 65_535
"""A triangle's material number is 16 bits."""
INSTANCES_MAX = 1_000_000
"""Every node holds the instance table: 52 MB at this number."""
LIGHT_TRIANGLES_MAX = 1_000_000
"""Every node holds the light table: 104 MB at this number."""
TEXTURE_SIDE_MAX = 16_384
"""Pixels along a texture's side; beyond it a file is more likely a decompression bomb than an image."""
TEXTURE_PIXELS_MAX = 8_192 * 8_192
"""Pixels of one texture: 256 MiB decoded, so that one image alone stays far below 2 GiB."""
TEXTURE_PIXELS_ALL_MAX = 512 * TEXTURE_PIXELS_MAX
"""Pixels of all images of a file by their heads, 128 GiB decoded: their tiles would need more pages of tables than a scene has."""
TEXTURE_TILE_SIDE = 120
"""A tile of 120 x 120 RGBA8 pixels, 57,600 bytes, fits one record."""
ENVIRONMENT_TEXELS_MAX = 4_096 * 2_048
"""Texels of an environment map, which every node holds: 128 MiB with its tables; 839 pages of the scene's."""
TABLE_PAGES_MAX = 2_500
"""Pages of all tables of a scene: their locations fit the scene document, which is one record."""

assert TEXTURE_TILE_SIDE**2 * 4 + 64 <= PAYLOAD_BYTES_MAX
assert TABLE_PAGES_MAX * 20 + 8_192 <= PAYLOAD_BYTES_MAX

CURVE_ARCS_MAX = 1 << 18
"""Arcs that a box may become: memory and time of the search grow with them, and nobody asks for that many."""
assert CIPHERTEXT_BYTES_MAX + RECORD_OVERHEAD_BYTES_MAX < FRAME_BYTES_MAX
assert LOG_BYTES_MAX < BULK_BYTES_MAX < FRAME_BYTES_MAX
assert RANGE_LOCATIONS_MAX * (22 + 18) < BULK_BYTES_MAX
assert LOG_RECORD_BYTES_MAX < LOG_BYTES_MAX < LOG_RECORDS_MAX * 66
assert LOG_TAIL_RECORDS_KEPT < LOG_TAIL_RECORDS_MAX and LOG_TAIL_BYTES_KEPT + LOG_RECORD_BYTES_MAX < LOG_TAIL_BYTES_MAX < LOG_BODY_BYTES_MAX
assert CONFIGURATIONS_MAX * 1_000 < BULK_BYTES_MAX
assert COMPARED_ARCS_MAX * COMPARED_RECORDS_MAX * 128 < BULK_BYTES_MAX
assert COPIES_TOLD_MAX <= COMPARED_ARCS_MAX
assert POOL_NODES_MAX <= PARTICIPANTS_MAX <= NODES_MAX
assert VOTERS_MAX <= DECIDERS_MAX <= PARTICIPANTS_MAX
assert 2 * LOG_VALUE_BYTES_MAX + 2**17 < FRAME_BYTES_MAX

# Connections (world/).
PENDING_HANDSHAKES_MAX = 64
"""Connections that have not shown a certificate yet; the oldest of the source that would have most makes room."""
KNOCKS_BURST = 1_024
"""Connections that one address may open at a port at once and that lead to nothing, or have not yet: a thousand clients behind it come back together."""
KNOCKS_PER_S = 128.0
"""And this many more each second; one that says nothing costs a quarter of a millisecond, which makes a thirtieth of a core."""
HANDSHAKES_BURST = 64
"""TLS handshakes of one address that may fail at once: as many as are under way when the nodes of one machine start together; those that
end well are given back."""
HANDSHAKE_GAP_S = 0.005
"""Between the beginnings of two handshakes at a port: each holds up all else for a millisecond or two, and many at once would in a row."""
HANDSHAKES_PER_S = 16.0
"""And this many more each second: each costs some two milliseconds."""
PEER_HANDSHAKES_BURST = 32
"""Handshakes that end well and are given back to the address, of one peer at once: with those that count against it, more than it may have connections."""
PEER_HANDSHAKES_PER_S = 8.0
"""And this many more each second: a program that is started again and again has one connection each time."""
HANDSHAKE_S_MAX = 10.0
"""Seconds that a peer may take to show a certificate: two cores under full load need about one."""
HELLO_S_MAX = 3.0
"""Of these, until the first byte is here: it is on its way as soon as the connection stands."""
NEWCOMERS_MAX = 8
"""Connections of newcomers, which show no certificate, that a node talks to at a time. One more pushes out the
oldest of the address that has most with it, but none that has shown an open invitation."""
NEWCOMERS_BURST = 32
"""Newcomers of one address that show no open invitation, at once: a token that is no good is tried a few times."""
NEWCOMERS_PER_S = 1.0
"""And this many more each second: many addresses that push each other out leave who comes the time to ask."""
NEWCOMER_S_MAX = 30.0
"""Seconds that one of them may take in all: three to ask, and the cluster's log has to take it in."""
CONNECTIONS_MAX = 1_024
"""Authenticated connections to one port: every node and client of a cluster several times over."""
REQUESTS_IN_FLIGHT_MAX = 256
"""Requests of ours that wait for an answer on one connection."""
REQUESTS_HANDLED_MAX = 64
"""Requests of one connection that are handled at a time; beyond it nothing more is read from it."""
REQUEST_BYTES_HANDLED_MAX = 4 * FRAME_BYTES_MAX
"""Bytes of those requests: memory that one connection can bind."""
ANSWER_BYTES_MAX = 4 * FRAME_BYTES_MAX
"""What the answers to those of them together may come to that are worked on at a time: a peer that asks for much and reads
nothing binds these, each as a packet and as its bytes."""
CONNECTIONS_PER_PEER_MAX = 64
"""Connections of one peer to one port: a process has one, and one user may run many."""
PEER_REQUESTS_HANDLED_MAX = 2 * REQUESTS_HANDLED_MAX
"""Requests of one peer at one port that are handled at a time, over all its connections."""
PEER_REQUEST_BYTES_HANDLED_MAX = 2 * REQUEST_BYTES_HANDLED_MAX
PEER_ANSWER_BYTES_MAX = 2 * ANSWER_BYTES_MAX
FRAME_S_MAX = 60.0
"""Seconds that we wait, in all, for the rest of a frame that has begun: 2 MiB at 35 KB/s."""
SEND_STALL_S_MAX = 30.0
"""Seconds without any progress in sending, after which a peer counts as gone."""

# Leases (specs/26-modes.md).
LEASE_LOOK_S = 1.0
"""Whoever acts by a lease looks at its own clock so often, at least. While the machine sleeps that clock goes on, and Trio's deadlines stand still:
one at the lease's end would come too late by as long as it slept."""

# Store (specs/10-store.md).
STORE_QUEUE_CHANGES_MAX = 1_024
"""Changes that wait for the store's writer; beyond it callers wait."""
STORE_BATCH_BYTES_MAX = 16 * 1024 * 1024
"""Bytes of one commit: about 256 full records, so that the first of a batch does not wait long for the last."""
STORE_READ_BATCH_MAX = 128
"""Records that one call in a reading thread copies: 8 MiB at most, so that threads are shared fairly."""
STORE_RESERVE_BYTES = 256 * 1024 * 1024
"""Free disk that new records leave alone, so that what was accepted can still be moved and repaired."""

assert REQUESTS_HANDLED_MAX <= REQUESTS_IN_FLIGHT_MAX
assert STORE_BATCH_BYTES_MAX >= FRAME_BYTES_MAX

# Client (client/).
CLIENT_REQUEST_S = 30.0
"""Seconds that a node may take to answer: a durable write behind a full queue on an old disk."""
CLIENT_NEXT_S = 2.0
"""Seconds of silence of one node after which another one is asked as well, where any may answer."""
CLIENT_CONTACT_S = 30.0
"""For a client's call as long as nobody has answered it anything: who has no network hears so within the time that one answer may take."""
CLIENT_CONTACT_NEXT_S = 0.5
"""Seconds of silence after which the next node is asked as well till then: most of those that a profile knows may be away for good."""
CLIENT_CONTACT_ASKED_MAX = 64
"""Nodes that are asked one question at a time till then: as many as there are such seconds in that time, for none of them may answer at all."""
CLIENT_HEDGE_S = 0.5
"""So long a read waits for an owner before holders of copies are asked as well, as long as it is not known how long answers take."""
CLIENT_HEDGE_S_MIN = 0.01
"""However fast answers are: a node that does something else for a moment is no reason to ask two others."""
CLIENT_ASKED_MAX = 3
"""Nodes that are asked one question at a time, where any may answer."""
CLIENT_OPINIONS = 3
"""Nodes that are asked about what one of them may lie about; the newest of what can be believed counts."""
CLIENT_LOOKED_MAX = 16
"""Nodes whose lists are looked through before a client says that there is no such thing."""
CLIENT_OPINION_S = 0.5
"""Seconds that a client waits for another node's answer of these once it has one."""
CLIENT_STATUS_S = 5.0
"""Seconds after which a node counts as missing when its status is asked for."""
CLIENT_TRIES_MAX = 4
"""Tries of one call; with the pauses between them a restarting node is waited for about two seconds."""
CLIENT_LOG_TRIES_MAX = 12
"""Tries to change a scene's log while others change it, too: each try loses against one of them at most."""
CLIENT_DECIDE_S = 13.0
"""Seconds that a node may take over a proposal that participants decide: it tries for a part of them, or asks others, and then says why it could not."""
CLIENT_DECIDE_NEXT_S = 3.0
"""Seconds of silence of one participant after which the next one is asked as well: two that propose at once hold each other up."""
CLIENT_AUTHOR_S = 30.0
"""Seconds after which an author makes no further try to have something decided by participants."""
CLIENT_BOX_ARCS = 64
"""Arcs of the line that a box is looked for in: each costs a request, and fewer arcs hold more that is not in the box."""
CLIENT_BUSY_TRIES_MAX = 12
"""Tries of a call whose node answers "not now": at the shortest pauses 13 s, longer than a node is without a lease."""
CLIENT_PAUSE_S = 0.15
"""The first pause between tries; each is three times the one before, give or take a half."""
CLIENT_PAUSE_S_MAX = 3.0
"""Pauses do not grow beyond this."""
CLIENT_FRAMES_IN_FLIGHT = 8
"""Bulk requests of one client at a time: 16 MiB on the way."""
CLIENT_FRAMES_PER_NODE = 2
"""Of these to one node: one on the way while the other is worked on."""
CLIENT_SMALL_RECORDS = 4
"""A question for so few records, 250 KiB at most, waits for no large ones of the same client."""
CLIENT_SMALL_PER_NODE = 8
"""Of these at a time."""
CLIENT_FRAME_BYTES = 2 * 1024 * 1024
"""Records of one bulk write: the round trip is small beside it, and others still get their turn on the line."""
CLIENT_FRAME_RECORDS = 1_024
"""Records of one bulk write, so that verifying them takes a node less than a tenth of a second."""
CLIENT_GET_KEYS = 64
"""Keys of one bulk read: full records make 3.7 MiB of reply."""
CLIENT_PART_BYTES = 512 * 1024
"""What a holder of copies is asked for at a time, about, where several are read at once: some milliseconds of work."""
CLIENT_PART_RECORDS = 8
"""Records of such a part at least."""
CLIENT_IMPORT_BATCHES = 3
"""Batches of an import that are being stored at a time, each of CLIENT_FRAME_BYTES; one more waits."""
CLIENT_BATCH_BYTES = 1024 * 1024
"""Payload that one visit of a worker thread seals or opens."""

assert CLIENT_FRAME_BYTES + CIPHERTEXT_BYTES_MAX + RECORD_OVERHEAD_BYTES_MAX < BULK_BYTES_MAX
assert CLIENT_FRAME_RECORDS <= BULK_ITEMS_MAX
assert CLIENT_GET_KEYS * (CIPHERTEXT_BYTES_MAX + RECORD_OVERHEAD_BYTES_MAX) < BULK_BYTES_MAX
