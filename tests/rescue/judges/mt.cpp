#include <bits/stdc++.h>
using namespace std;
struct Ray{double a,d;int k;double low,near;};
struct Map{unordered_map<int,float> e; float at(int r,int c)const{auto i=e.find(r*4096+c);return i==e.end()?0:i->second;}};
struct V{double x,y,h,step;int b;vector<Ray> rays;};
struct Case{string set;int robot,n;double t;double x,y,h;vector<Ray> rays;Map K,Q;vector<V> v;double cx,cy;double tx,ty,th;double px,py;double e0;double pbx,pby,pbh;}; // px,py: error of the previous search
static void rays(const char*s,vector<Ray>&o){Ray r;int n;while(sscanf(s,"%lf,%lf,%d,%lf,%lf%n",&r.a,&r.d,&r.k,&r.low,&r.near,&n)==5){o.push_back(r);s+=n;if(*s==';')s++;}}
vector<Case> load(const char*fn){
 struct R{vector<array<double,4>>P;vector<pair<double,string>>L;};
 map<string,R> rs;vector<string> order;
 ifstream f(fn);string l;
 while(getline(f,l)){
  if(l.size()<2||l[1]!=' ')continue;
  if(l[0]=='Y'){string k=l.substr(2,l.find(' ',2)-2);if(find(order.begin(),order.end(),k)==order.end())order.push_back(k);}
  else if(l[0]=='P'){char k[40];double t,x,y,h;if(sscanf(l.c_str(),"P %39s %lf %lf %lf %lf",k,&t,&x,&y,&h)==5)rs[k].P.push_back({t,x,y,h});}
  else if(l[0]=='E'){size_t p=l.find(" Log ");if(p==string::npos)continue;char k[40];double t;if(sscanf(l.c_str(),"E %39s %lf",k,&t)!=2)continue;char c=l[p+5];if(strchr("SRKQVvCX",c)&&l[p+6]==' ')rs[k].L.push_back({t,l.substr(p+5)});}
 }
 vector<Case> out;
 for(size_t i=0;i<order.size();i++){auto&r=rs[order[i]];
  Case c;bool have=false;bool first=true;double F[6];double ev[2]={0,0};double lastb[3]={0,0,0};int n=0;
  auto truth=[&](double t){size_t j=0;size_t lo=0,hi=r.P.size();while(lo<hi){size_t m=(lo+hi)/2;if(r.P[m][0]<=t)lo=m+1;else hi=m;}j=lo?lo-1:0;return r.P[j];};
  for(auto&[t,s]:r.L){
   char k=s[0];
   if(k=='S'){c=Case();sscanf(s.c_str(),"S %lf %lf %lf",&c.x,&c.y,&c.h);c.t=t;have=true;}
   else if(!have)continue;
   else if(k=='R')rays(s.c_str()+2,c.rays);
   else if(k=='v'){if(c.v.size())rays(s.c_str()+2,c.v.back().rays);}
   else if(k=='K'||k=='Q')for(const char*z=s.c_str()+2;z;){int rr,cc,o;sscanf(z,"%d %d %n",&rr,&cc,&o);const char*p=z+o;z=strchr(p,'|');if(z)z++;for(int q=0;p[q]&&p[q]!='|';q++)if(p[q]!='_')(k=='K'?c.K:c.Q).e[rr*4096+cc+q]=(p[q]-65)/3.0-4;}
   else if(k=='V'){V v;int o=0;sscanf(s.c_str(),"V %lf %lf %lf %lf %d %n",&v.x,&v.y,&v.h,&v.step,&v.b,&o);rays(s.c_str()+o,v.rays);c.v.push_back(v);}
   else if(k=='C'){double a,b;sscanf(s.c_str(),"C %lf %lf %lf %lf",&a,&b,&c.cx,&c.cy);
    auto P=truth(t);if(first){first=false;F[0]=P[1];F[1]=P[2];F[2]=P[3];F[3]=c.x;F[4]=c.y;F[5]=c.h;}
    double g=F[5]-F[2],dx=P[1]-F[0],dy=P[2]-F[1];
    c.tx=F[3]+cos(g)*dx-sin(g)*dy;c.ty=F[4]+sin(g)*dx+cos(g)*dy;c.th=P[3]+g;
    c.set=string(fn);c.set=c.set.substr(c.set.size()-7,3);c.robot=i+1;c.n=n++;
    c.px=ev[0];c.py=ev[1];c.e0=hypot(c.px,c.py);ev[0]=c.x+c.cx-c.tx;ev[1]=c.y+c.cy-c.ty;
    c.pbx=lastb[0];c.pby=lastb[1];
    // relative to the previous search
    static double LP[3],LB[3];
    if(c.n>0){double gg=LB[2]-LP[2],ex=P[1]-LP[0],ey=P[2]-LP[1];c.px=c.py=0;
     c.tx=LB[0]+cos(gg)*ex-sin(gg)*ey;c.ty=LB[1]+sin(gg)*ex+cos(gg)*ey;c.th=P[3]+gg;}
    LP[0]=P[1];LP[1]=P[2];LP[2]=P[3];LB[0]=c.x+c.cx;LB[1]=c.y+c.cy;LB[2]=c.h;
    lastb[0]=c.x+c.cx;lastb[1]=c.y+c.cy;
    if(c.n>0)out.push_back(c);have=false;}
  }
 }
 return out;
}
const double CELL=.15;
static int cl(double v){return (int)floor(v/CELL)+2048;}
map<string,double> A;
double arg(const char*k,double d){auto i=A.find(k);return i==A.end()?d:i->second;}
struct Res{double x,y,h;};
// HEAD's matcher on a map
Res head(const Case&c,const Map&m,int M,double ASIDE,double BETTER,double hd=0){
 vector<array<int,2>> ends;vector<vector<array<int,2>>> pas;
 for(auto&r:c.rays){if(!r.k)continue;double a=c.h+hd+r.a,dx=cos(a),dy=sin(a);
  if(r.d<3)ends.push_back({cl(c.x+r.d*dx),cl(c.y+r.d*dy)});
  vector<array<int,2>> p;for(double w=2*CELL;w<=min(r.low,3.)-2*CELL;w+=CELL)p.push_back({cl(c.x+w*dx),cl(c.y+w*dy)});pas.push_back(p);}
 auto fit=[&](int ox,int oy){double s=0;for(auto&e:ends){int x=e[0]+ox,y=e[1]+oy;float v=m.at(x,y);if(v>.2)s+=1;else if(m.at(x+1,y)>.2||m.at(x-1,y)>.2||m.at(x,y+1)>.2||m.at(x,y-1)>.2)s+=.5;else if(v<-.2)s-=.5;}
  for(auto&p:pas)for(auto&q:p)if(m.at(q[0]+ox,q[1]+oy)>1){s-=.5;break;}return s;};
 double most=fit(0,0)+BETTER;int bx=0,by=0;
 for(int dx=-M;dx<=M;dx++)for(int dy=-M;dy<=M;dy++){double as=hypot(dx,dy);if(as>M)continue;double f=fit(dx,dy)-ASIDE*as;if(f>most){most=f;bx=dx;by=dy;}}
 return {c.x+bx*CELL,c.y+by*CELL,most};
}
// smooth likelihood
Res smooth_(const Case&c,const Map&m){
 int M=arg("M",10);double sig=arg("sig",.2),wp=arg("wp",.5),wf=arg("wf",.3),aside=arg("aside",1.2),better=arg("better",2),pl=arg("pl",0);
 int H=arg("H",0);double hs=arg("hs",2)*M_PI/180,hc=arg("hc",1);
 // occupied cells
 int r0=cl(c.x)-40,c0=cl(c.y)-40;const int S=81;static double D[81][81];static double O[81][81];
 vector<array<int,2>> occ;for(int i=0;i<S;i++)for(int j=0;j<S;j++){O[i][j]=m.at(r0+i,c0+j);D[i][j]=1e9;if(O[i][j]>arg("occ",.2))occ.push_back({i,j});}
 int W=ceil(3*sig/CELL);
 for(auto&o:occ)for(int i=max(0,o[0]-W);i<=min(S-1,o[0]+W);i++)for(int j=max(0,o[1]-W);j<=min(S-1,o[1]+W);j++)D[i][j]=min(D[i][j],CELL*hypot(i-o[0],j-o[1]));
 static double E[81][81];for(int i=0;i<S;i++)for(int j=0;j<S;j++){double d=D[i][j];E[i][j]=d<1e8?exp(-d*d/2/sig/sig):0;if(O[i][j]<-.2)E[i][j]-=wf*(d<1e8?1-exp(-d*d/2/sig/sig):1);}
 double best=-1e9,b0=0;Res R{c.x,c.y,0};
 // direction of the drive
 double ux=c.x-c.pbx,uy=c.y-c.pby,ul=hypot(ux,uy);if(ul>1e-6){ux/=ul;uy/=ul;}
 for(int hi=-H;hi<=H;hi++){
  double hd=hi*hs;vector<array<double,2>> ends;vector<double> wts;vector<vector<array<double,2>>> pas;
  for(auto&r:c.rays){if(!r.k)continue;double a=c.h+hd+r.a,dx=cos(a),dy=sin(a);
   if(r.d<arg("far",3)){ends.push_back({(c.x+r.d*dx)/CELL+2048-r0,(c.y+r.d*dy)/CELL+2048-c0});wts.push_back(arg("dw",0)?min(1.,arg("dw",0)/r.d):1);}
   vector<array<double,2>> p;for(double w=2*CELL;w<=min(r.low,3.)-2*CELL;w+=CELL)p.push_back({(c.x+w*dx)/CELL+2048-r0,(c.y+w*dy)/CELL+2048-c0});pas.push_back(p);}
  auto at=[&](double(*T)[81],double x,double y){int i=floor(x),j=floor(y);return i<0||j<0||i>=S||j>=S?0.:T[i][j];};
  for(int dx=-M;dx<=M;dx++)for(int dy=-M;dy<=M;dy++){double as=hypot(dx,dy);if(as>M)continue;
   double s=0;for(size_t q=0;q<ends.size();q++)s+=wts[q]*at(E,ends[q][0]+dx,ends[q][1]+dy);
   for(auto&p:pas)for(auto&q:p)if(at(O,q[0]+dx,q[1]+dy)>1){s-=wp;break;}
   if(dx==0&&dy==0&&hi==0)b0=s;
   double al=(dx*ux+dy*uy),ac=sqrt(max(0.,as*as-al*al));
   double cost=pl?hypot(ac,al<0?al*pl:al)*aside:aside*as;
   if(arg("quad",0)){double k=cost/aside;cost=arg("quad",0)*k*k;}
   s-=cost+hc*abs(hi);
   if(s>best){best=s;R={c.x+dx*CELL,c.y+dy*CELL,s};}}
 }
 if(best<b0+better)R={c.x,c.y,b0};
 return R;
}
int main(int n,char**v){
 vector<Case> all;string mode=v[1];
 for(int i=2;i<n;i++){string a=v[i];size_t e=a.find('=');if(e!=string::npos)A[a.substr(0,e)]=atof(a.c_str()+e+1);else{auto x=load(v[i]);all.insert(all.end(),x.begin(),x.end());}}
 double lim[]={0,.2,.4,.6,.8,1.05,1.5,9};int N[8]={},G[8]={},G6[8]={};int tn=0,tg=0,t6=0,big=0;double sum=0;
 for(auto&c:all){if(c.e0>=arg("e0",.6))continue;double he=remainder(c.h-c.th,2*M_PI);if(fabs(he)>.2)continue;
  double bx=c.x-c.tx-c.px,by=c.y-c.ty-c.py,b=hypot(bx,by);
  if(b>9)continue;
  Res r;if(mode=="head")r=head(c,c.K,arg("M",7),arg("aside",1.2),arg("better",2));else if(mode=="headq")r=head(c,c.Q,arg("M",7),arg("aside",1.2),arg("better",2));
  else if(mode=="smooth")r=smooth_(c,c.K);else if(mode=="smoothq")r=smooth_(c,c.Q);else if(mode=="log")r={c.x+c.cx,c.y+c.cy,0};else r={c.x,c.y,0};
  double e=hypot(r.x-c.tx-c.px,r.y-c.ty-c.py);
  int k=0;while(b>=lim[k+1])k++;
  N[k]++;G[k]+=e<.35;G6[k]+=e<.6;tn++;tg+=e<.35;t6+=e<.6;sum+=min(e,1.5);big+=e>b+.3&&e>.5;
  if(arg("list",0)&&e>.6)printf("%s %d #%d t%.0f before %.2f (%.2f,%.2f) after %.2f moved (%.2f,%.2f)\n",c.set.c_str(),c.robot,c.n,c.t,b,bx,by,e,r.x-c.x,r.y-c.y);
 }
 printf("%-8s n %d  <.35 %.1f%%  <.6 %.1f%%  mean %.3f worse %d |",mode.c_str(),tn,100.*tg/tn,100.*t6/tn,sum/tn,big);
 for(int k=0;k<7;k++)printf(" %.2g: %d/%d/%d",lim[k],G[k],G6[k],N[k]);puts("");
}
