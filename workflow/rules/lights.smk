rule lights:
    "Projects panoramas to spherical harmonics, and selects lights by filters and k-means."
    input:
        PLAN.panoramas,
        SETTINGS["lights"]["veto"] or [],
    output:
        lights=LIGHTS,
        table=f"{OUT}/lights/lights.csv",
        record=f"{OUT}/lights/chain.json",
    log:
        f"{OUT}/log/lights.log",
    benchmark:
        f"{OUT}/benchmark/lights/all.tsv"
    params:
        panoramas=SETTINGS["panoramas"],
        lights=SETTINGS["lights"],
        order=SETTINGS["bake"]["order"],
        code=code_hash("lights"),
    script:
        "../scripts/lights.py"
