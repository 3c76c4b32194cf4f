#include "core.h"
int main(int c,char**v){map<int,int> h;int n=0;for(int i=1;i<c;i++){auto runs=load(v[i]);
 for(auto&r:runs)for(auto&g:r.segs){bool any=false;Pose pa,pt;int k=0;for(auto&x:g){if(x.tag!='S')continue;k++;
  if(any){double er=wrap(x.B.h-pa.h-(x.T.h-pt.h))*57.3,ea=wrap(x.A.h-pa.h-(x.T.h-pt.h))*57.3;n++;
   double turned=(x.T.h-pt.h)*57.3;
   if(fabs(er)>22||fabs(ea)>22)printf("%s %s scan %d raw %.0f aligned %.0f\n",v[i],r.key.substr(0,5).c_str(),k,er,ea);
   h[(int)min(fabs(er)/5,9.)]++;}
  any=true;pa=x.A;pt=x.T;}}}
 for(auto&[b,k]:h)printf("raw %d: %d\n",b*5,k);printf("%d\n",n);}
