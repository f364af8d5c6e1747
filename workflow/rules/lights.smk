rule lights:
    "Projects panoramas to spherical harmonics, and selects lights by filters and k-means."
    input:
        PLAN.panoramas,
    output:
        lights=update(LIGHTS),
        table=update(f"{DATA}/lights/lights.csv"),
        record=update(f"{DATA}/lights/chain.json"),
    log:
        f"{DATA}/log/lights.log",
    params:
        panoramas=SETTINGS["panoramas"],
        lights=SETTINGS["lights"],
        bake={"order": SETTINGS["bake"]["order"]},
    script:
        "../scripts/lights.py"
