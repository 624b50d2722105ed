<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology">
  <renderer-v2 type="singleSymbol" symbollevels="0" forceraster="0" enableorderby="0">
    <symbols>
      <symbol name="0" type="line" alpha="1" clip_to_extent="1" force_rhr="0">
        <layer class="ArrowLine" enabled="1" locked="0" pass="0">
          <Option type="Map">
            <Option name="arrow_width" type="QString" value="0.6"/>
            <Option name="arrow_start_width" type="QString" value="0.6"/>
            <Option name="head_length" type="QString" value="2.5"/>
            <Option name="head_thickness" type="QString" value="1.6"/>
            <Option name="is_curved" type="QString" value="0"/>
          </Option>
          <symbol name="@0@0" type="fill" alpha="1" clip_to_extent="1" force_rhr="0">
            <layer class="SimpleFill" enabled="1" locked="0" pass="0">
              <Option type="Map">
                <Option name="color" type="QString" value="230,40,40,255"/>
                <Option name="style" type="QString" value="solid"/>
                <Option name="outline_style" type="QString" value="no"/>
              </Option>
            </layer>
          </symbol>
        </layer>
      </symbol>
    </symbols>
  </renderer-v2>
</qgis>
