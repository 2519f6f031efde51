"""HTTP over the same verbs: clips and captures in, reports, replays and clips out.

    upload ─ check (child) ─▶ queue (history database) ─ worker ─▶ child under limits ─▶ results

The server itself never opens what strangers send: it streams it to disk and hands it to a child
process. Jobs live in the database and results are renamed into place, so the server may die at
any moment. Needs the extra ``service``.
"""
