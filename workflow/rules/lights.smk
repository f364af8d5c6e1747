rule lights:
    "Projects panoramas to spherical harmonics, and selects lights by filters and k-means."
    input:
        PLAN.panoramas,
    output:
        lights=LIGHTS,
        table=f"{DATA}/lights/lights.csv",
        record=f"{DATA}/lights/chain.json",
    log:
        f"{DATA}/log/lights.log",
    benchmark:
        f"{DATA}/benchmark/lights/all.tsv"
    params:
        *stamps(PLAN.panoramas),
        panoramas=SETTINGS["panoramas"],
        lights=SETTINGS["lights"],
        order=SETTINGS["bake"]["order"],
        code=code_hash("lights", [SETTINGS["panoramas"]["source"]]),
    script:
        "../scripts/lights.py"
